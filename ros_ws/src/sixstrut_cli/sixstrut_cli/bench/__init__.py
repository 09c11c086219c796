"""What `sixstrut bench` measures: our solver beside MuJoCo, on the same robot and the same policies, in one run."""
