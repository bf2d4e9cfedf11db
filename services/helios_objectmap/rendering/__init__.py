"""Rendering of Gaussians into a camera (eq. 1): one interface, a CPU renderer, a CUDA renderer."""
