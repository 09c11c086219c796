"""Before a robot moves: the doctor's checks, and calibrating with a person."""
