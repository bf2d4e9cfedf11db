"""Immutable published versions of the map, and what changed between them."""
