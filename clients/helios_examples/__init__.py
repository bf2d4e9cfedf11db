"""A robot and a detector to copy from, without hardware or model (`docs/tutorials/your-own-robot.md`)."""
