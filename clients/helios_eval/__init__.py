"""Benchmarks of speed and of tasks. May host services in its own process; reads ground truth."""
