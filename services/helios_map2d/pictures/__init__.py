"""The map as a picture for people."""
