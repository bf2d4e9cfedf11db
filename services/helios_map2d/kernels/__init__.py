"""Numba kernels of the 2D maps, called by the layers and by `LayerStack`."""
