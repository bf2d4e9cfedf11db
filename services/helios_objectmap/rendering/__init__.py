"""Gaussians as a camera sees them (eq. 1): one interface, a renderer for the CPU, one for CUDA."""
