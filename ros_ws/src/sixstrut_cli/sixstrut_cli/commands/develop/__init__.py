"""Commands for whoever works on sixstrut itself."""
