"""Study of a detector's errors: how often, with which scores, and how long they persist."""
