"""Running a session of trials."""
