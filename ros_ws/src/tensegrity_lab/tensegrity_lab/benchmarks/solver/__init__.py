"""The solver beside MuJoCo."""
