"""A robot and a client that drives it. Both know only the messages and the page of keys."""
