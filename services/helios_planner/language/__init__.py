"""From what people type to what a task is: words, clauses, roles (no model needed)."""
