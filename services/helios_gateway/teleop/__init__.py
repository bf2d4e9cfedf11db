"""Teleoperation: pacing of short moves, the lease, and one session per WebSocket."""
