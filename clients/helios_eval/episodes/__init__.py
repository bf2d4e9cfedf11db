"""One episode: its specification, the stack that plays it, and its record."""
