"""Rendering of the map as a picture for people."""
