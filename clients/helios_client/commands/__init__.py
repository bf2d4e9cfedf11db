"""The sub-commands of `helios`, and how they print."""
