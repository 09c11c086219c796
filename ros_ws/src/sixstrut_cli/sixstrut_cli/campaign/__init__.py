"""A campaign: whole libraries on virtual prototypes, by the batch solver, and a sample of it through the whole stack."""
