"""The digital twin, without ROS: it follows a bridge's events bit for bit."""
