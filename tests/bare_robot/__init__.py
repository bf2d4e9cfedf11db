"""A robot, and somebody who drives it, that know only the messages and the page of keys."""
