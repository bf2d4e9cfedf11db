"""A robot and a detector to copy from, without hardware or model (`docs/your-own-robot.md`)."""
