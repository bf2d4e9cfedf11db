"""Fetching and checking of model weights, for `helios models`."""
