"""Instances of objects: connected voxels of Gaussians, with stable numbers."""
