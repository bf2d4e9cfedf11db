"""Immutable versions of a map: their tiles, what is new in one, and how they travel."""
