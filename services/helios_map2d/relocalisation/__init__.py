"""Relocalisation: alignment of the present map with a stored one. Pure functions of arrays."""
