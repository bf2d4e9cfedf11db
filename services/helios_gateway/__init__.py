"""HTTP, events and the dashboard: the face of the robot towards people and programs."""
