"""Layers of a map over one grid: occupancy, explored area, values, frontiers, reachability."""
