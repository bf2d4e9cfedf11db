"""From Gaussians to things: voxels joined into instances that keep their numbers."""
