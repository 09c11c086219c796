"""Sessions of trials: planned, run, recorded and reported."""
