"""Robots to copy from: each runs without hardware (`docs/your-own-robot.md`)."""
