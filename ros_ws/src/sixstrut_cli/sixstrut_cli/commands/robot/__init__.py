"""Commands for a robot, real or virtual."""
