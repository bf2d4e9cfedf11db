"""Numba kernels of the 2D maps, reached through the layers and the stack of them."""
