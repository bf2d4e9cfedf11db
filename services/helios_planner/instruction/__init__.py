"""From a sentence to the things and places that a task names."""
