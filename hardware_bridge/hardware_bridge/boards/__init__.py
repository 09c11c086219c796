"""Servo boards as bytes: a board is a codec and its quirks."""
