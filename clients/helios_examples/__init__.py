"""Example robot, detector, scorer and agents to copy (`docs/tutorials/your-own-robot.md`)."""
