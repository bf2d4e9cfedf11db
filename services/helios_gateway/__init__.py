"""HTTP and WebSocket gateway of the robot: API, event stream and dashboard."""
