"""Bytes to and from one board: port, writes, replies, loss, backpressure."""
