"""Driving the robot by hand: pacing of short moves, the lease, one session over a socket."""
