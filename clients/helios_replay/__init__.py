"""Replay of a recording or data set as a robot that cannot move."""

from helios_replay.driver import ReplayDriver

__all__ = ["ReplayDriver"]
