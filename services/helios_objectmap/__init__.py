"""Sparse 3D Gaussian object map: Dirichlet semantics, instances, scores, information gain."""
