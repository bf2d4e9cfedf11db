"""Sparse 3D Gaussian object map: Dirichlet class evidence, instances, scores, information gain."""
