"""The VFIFE solver: forces, one step, one robot, its support and its actuators."""
