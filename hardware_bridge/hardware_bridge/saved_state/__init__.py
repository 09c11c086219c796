"""What is remembered of one robot over restarts: last pulses, duty, and whose they are."""
