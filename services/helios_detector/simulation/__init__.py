"""Simulated detectors: simulator ground truth, with or without the errors of a noise table."""
