"""Fusion of one observation: geometry, class evidence, and the history of views."""
