"""Paths, poses and base placement as pure functions of arrays."""
