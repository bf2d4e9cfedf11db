"""What one observation changes: geometry, class evidence, and the history of views."""
