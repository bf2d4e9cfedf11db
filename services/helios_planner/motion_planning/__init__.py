"""Paths, poses and places to stand. Pure: arrays in, arrays out."""
