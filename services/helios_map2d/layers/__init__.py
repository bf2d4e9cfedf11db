"""What a map is made of over one grid: occupancy, explored area, values, frontiers, reach."""
