"""The running bridge: engine, frame timer, the port's process and its remote."""
