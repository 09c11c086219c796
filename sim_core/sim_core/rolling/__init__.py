"""What a roll is, and whether it succeeded: one, or many at once."""
