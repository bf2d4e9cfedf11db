"""A robot and a detector to copy from (`docs/tutorials/your-own-robot.md`)."""
