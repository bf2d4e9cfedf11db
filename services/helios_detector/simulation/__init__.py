"""Simulated detectors: the truth of the simulator, as it is or with the errors of a noise table."""
