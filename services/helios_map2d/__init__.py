"""2D maps of a home: occupancy, explored area, frontiers and value layers (paper 3.1.1, 3.1.2)."""
