"""One episode: what it depends on, the house it is played in, and what is kept of it."""
