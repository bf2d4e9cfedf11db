"""What is decided and why: pure functions from candidates to a decision (section 3.2)."""
