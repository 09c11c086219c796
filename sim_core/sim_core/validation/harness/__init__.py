"""How a case is run: any structure stepped, references without the solver."""
