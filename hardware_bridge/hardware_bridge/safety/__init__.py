"""What may move. Pure: no port, no clock, no ROS."""
