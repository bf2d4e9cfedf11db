"""The detector acknowledges each keyframe exactly once, whatever its outcome."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import pytest
from detector_rig import Faulty, Rig
from helios_core.errors import InvalidInput
from helios_core.topics import KEYFRAME
from helios_core.types import Frame
from helios_detector.backend import Judgement, Seen
from helios_detector.lexical_scorer import LexicalScorer


def test_an_answered_keyframe_is_acknowledged_after_its_observation() -> None:
    rig = Rig()
    rig.look_for()
    rig.bus.publish(KEYFRAME, rig.frame(7))
    (ack,) = rig.acks
    assert (ack.service, ack.part, ack.id.seq, ack.context_id) == (
        "detector",
        "observation",
        7,
        "c1",
    )
    assert (ack.accepted, ack.reason, len(rig.observations)) == (True, "", 1)


class FailingDetector(Faulty):
    """Raises the given error in `detect`."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def detect(self, frame: Frame, context: object):
        raise self.error


class FailingScorer(LexicalScorer):
    """Raises the given error in `judge`."""

    def __init__(self, error: BaseException) -> None:
        super().__init__()
        self.error = error

    def judge(self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]) -> Judgement:
        raise self.error


FAULTS = (InvalidInput("no mug model"), KeyError("mug"), SystemExit(3), MemoryError("too large"))


@pytest.mark.parametrize("error", FAULTS, ids=lambda e: type(e).__name__)
@pytest.mark.parametrize(
    "made",
    [lambda e: Rig(FailingDetector(e)), lambda e: Rig(scorer=FailingScorer(e))],
    ids=["detector", "scorer"],
)
def test_a_failed_keyframe_is_acknowledged_with_the_reason_shown_in_health(
    made: Callable[[BaseException], Rig], error: BaseException
) -> None:
    rig = made(error)
    rig.look_for()
    rig.bus.publish(KEYFRAME, rig.frame(3))
    (ack,) = rig.acks
    assert not ack.accepted
    assert ack.id.seq == 3
    assert ack.reason in rig.health.state[1]
    assert rig.health.state[0] == "degraded"


def test_an_unreadable_keyframe_is_acknowledged_as_refused() -> None:
    rig = Rig()
    rig.look_for()
    frame = rig.frame(4)
    del frame.calibration.K[:]
    rig.bus.publish(KEYFRAME, frame)
    (ack,) = rig.acks
    assert (ack.accepted, ack.id.seq) == (False, 4)
    assert ack.reason


def test_a_held_keyframe_is_refused_when_a_newer_keyframe_replaces_it() -> None:
    rig = Rig()
    rig.bus.publish(KEYFRAME, rig.frame(1))
    assert not rig.acks  # it may still be answered
    rig.bus.publish(KEYFRAME, rig.frame(2))
    assert [(a.id.seq, a.accepted) for a in rig.acks] == [(1, False)]
    assert "newer keyframe" in rig.acks[0].reason
    rig.look_for()
    assert [(a.id.seq, a.accepted) for a in rig.acks] == [(1, False), (2, True)]
