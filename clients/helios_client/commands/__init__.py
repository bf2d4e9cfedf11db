"""Sub-commands of `helios`, and their output."""
