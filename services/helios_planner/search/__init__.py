"""Where to look next, and when a candidate is good enough to act on (section 3.2)."""
