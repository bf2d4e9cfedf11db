"""The map as a file, and for other programs."""
