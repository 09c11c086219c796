"""The nodes `gait_planner` and `traveller`."""
