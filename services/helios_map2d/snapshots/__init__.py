"""Immutable published versions of the map, and the changes between them."""
