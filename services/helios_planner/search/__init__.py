"""Searches: where to look next, and when a candidate is good enough (section 3.2)."""
