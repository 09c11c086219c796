"""What the solver and the stack cost."""
