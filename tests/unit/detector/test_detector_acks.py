"""Whatever comes of a keyframe, the detector acknowledges that it has ended with it, once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import pytest
from detector_house import Faulty, House
from helios_core.errors import InvalidInput
from helios_core.topics import KEYFRAME
from helios_core.types import Frame
from helios_detector.backend import Judgement, Seen
from helios_detector.lexical_scorer import LexicalScorer


def test_an_answered_keyframe_is_acknowledged_after_its_observation() -> None:
    house = House()
    house.look_for()
    house.bus.publish(KEYFRAME, house.frame(7))
    (ack,) = house.acks
    assert (ack.service, ack.part, ack.id.seq, ack.context_id) == (
        "detector",
        "observation",
        7,
        "c1",
    )
    assert (ack.accepted, ack.reason, len(house.observations)) == (True, "", 1)


class Refusing(Faulty):
    """Raises what it is given."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def detect(self, frame: Frame, context: object):
        raise self.error


class RefusingScorer(LexicalScorer):
    """Raises what it is given."""

    def __init__(self, error: BaseException) -> None:
        super().__init__()
        self.error = error

    def judge(self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]) -> Judgement:
        raise self.error


FAULTS = (InvalidInput("no mug model"), KeyError("mug"), SystemExit(3), MemoryError("too large"))


@pytest.mark.parametrize("error", FAULTS, ids=lambda e: type(e).__name__)
@pytest.mark.parametrize(
    "made",
    [lambda e: House(Refusing(e)), lambda e: House(scorer=RefusingScorer(e))],
    ids=["detector", "scorer"],
)
def test_a_keyframe_that_a_back_end_refuses_is_acknowledged_with_the_reason_of_the_status(
    made: Callable[[BaseException], House], error: BaseException
) -> None:
    house = made(error)
    house.look_for()
    house.bus.publish(KEYFRAME, house.frame(3))
    (ack,) = house.acks
    assert not ack.accepted
    assert ack.id.seq == 3
    assert ack.reason in house.health.state[1]
    assert house.health.state[0] == "degraded"


def test_a_keyframe_that_cannot_be_read_is_acknowledged() -> None:
    house = House()
    house.look_for()
    frame = house.frame(4)
    del frame.calibration.K[:]
    house.bus.publish(KEYFRAME, frame)
    (ack,) = house.acks
    assert (ack.accepted, ack.id.seq) == (False, 4)
    assert ack.reason


def test_a_held_keyframe_is_acknowledged_when_a_newer_one_takes_its_place() -> None:
    house = House()
    house.bus.publish(KEYFRAME, house.frame(1))
    assert not house.acks  # it may still be answered
    house.bus.publish(KEYFRAME, house.frame(2))
    assert [(a.id.seq, a.accepted) for a in house.acks] == [(1, False)]
    assert "newer keyframe" in house.acks[0].reason
    house.look_for()
    assert [(a.id.seq, a.accepted) for a in house.acks] == [(1, False), (2, True)]
