"""Bridge service: hosts one RobotDriver, numbers frames, and keeps the lease and action results."""
