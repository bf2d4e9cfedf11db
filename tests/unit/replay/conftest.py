"""Makes `recording` a fixture of all tests of the replay."""

from tests.unit.replay.replay_recorded import recording

__all__ = ["recording"]
