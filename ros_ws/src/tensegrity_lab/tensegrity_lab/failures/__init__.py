"""Failures made to happen to the stack, and what must come of each."""
