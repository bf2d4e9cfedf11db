"""`recording` is a fixture of all."""

from tests.unit.replay.replay_recorded import recording

__all__ = ["recording"]
