"""Paths, poses and places to stand: geometry over one version of the map (appendix 6.1)."""
