"""The bridge: hosts one RobotDriver, gives frames their identity, keeps the lease and results."""
