"""Faults of a robot's services: their life cycle, and the recordings around them."""
