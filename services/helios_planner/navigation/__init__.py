"""Driving to a pose, with recovery behaviors."""
