"""The robot and its maps, as a task sees them: one small interface, and the bus behind it."""
