"""Decision rules: pure functions from candidates to a decision with its reason (section 3.2)."""
