"""Command line `helios`, the supervisor behind `helios up`, and the Python SDK."""
