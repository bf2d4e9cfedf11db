"""Numba kernels of the object map, each reached through a plain function of the floors above.

Pixel (u, v) has its centre at the integer coordinates (u, v), as in `helios_core.geometry`. The
image is cut into tiles of 16 x 16 pixels, and a row of a tile is one `Lanes` value. A tile owns its
pixels, so threads never share an output and results do not depend on their number.
"""
