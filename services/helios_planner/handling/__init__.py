"""Pick and place: approach, look once more, act, look at what came of it."""
