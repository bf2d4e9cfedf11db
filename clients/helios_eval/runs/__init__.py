"""Many episodes: which are wanted, on how many cores, and what they make together."""
