"""Faults, soak and load on a running HELIOS, judged by the simulator's ground truth."""
