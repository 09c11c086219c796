"""Recorded sessions read back: replayed, played, judged."""
