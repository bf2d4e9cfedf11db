"""Submission of tasks: instruction, agent, steps, settings; invalid values are refused by name."""

from __future__ import annotations

from typing import NoReturn

import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.topics import CANCEL, DECISIONS, LIST_TASKS, OBJECTS, RETIRE, SUBMIT, WHAT_IF
from planner_bus import Start, ended, submit, task
from planner_flat import MOVE


def test_a_task_for_an_agent_that_trusts_the_detector_needs_no_object_map(
    start: Start,
) -> None:
    _, bus, peers = start()
    peers.silent.add("objects")
    peers.bus.serve(OBJECTS, forbidden)
    peers.bus.serve(WHAT_IF, forbidden)
    peers.bus.serve(RETIRE, forbidden)
    done = ended(bus, submit(bus, agent="Trusting").id)
    assert (done.state, done.agent, done.cause) == ("succeeded", "trusting", ""), done.message
    assert peers.world.released is peers.world.things[3]


def forbidden(_: object) -> NoReturn:
    raise AssertionError("the object map was asked")


def test_an_unknown_agent_is_refused_at_once(start: Start) -> None:
    _, bus, _ = start()
    with pytest.raises(InvalidInput, match="choose one of helios"):
        submit(bus, agent="clever")
    assert not bus.call(LIST_TASKS, pb.Empty(), 5).tasks


def test_the_step_budget_of_a_task_ends_it(start: Start) -> None:
    _, bus, _ = start()
    done = ended(bus, submit(bus, max_steps=10).id)
    assert (done.state, done.cause, done.steps) == ("failed", "step budget", 10)


def test_the_settings_of_a_task_do_not_apply_to_the_next_task(start: Start) -> None:
    _, bus, _ = start()
    asked = pb.SubmitRequest(instruction=MOVE, settings={"alpha_d": "0.02", "rounds": "1"})
    own, after = bus.call(SUBMIT, asked, 5).id, submit(bus).id
    assert dict(ended(bus, own).settings) == {"alpha_d": "0.02", "rounds": "1"}
    ended(bus, after)

    def weights(id: str) -> set[float]:
        reported = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
        return {d.settings["alpha_d"] for d in reported if "alpha_d" in d.settings}

    assert (weights(own), weights(after)) == ({0.02}, {0.001})


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("ack_timeout_s", "9", "choose among alpha_d"),
        ("alpha_d", "much", "alpha_d is 'much'"),
        ("alpha_d", "-1", "alpha_d is '-1'"),
        ("tau_g", "nan", "tau_g is .nan."),
        ("cs_g", "nan", "finite number"),
        ("alpha_d", "1e999", "finite number"),
        ("alpha_d", "1e10", "at most 1000000000"),
        ("rounds", "9" * 30, "at most 1000000000"),
        ("gain_norm", "none", "gain_norm is 'none'"),
    ],
)
def test_an_invalid_setting_is_refused_by_name(
    start: Start, name: str, text: str, says: str
) -> None:
    _, bus, _ = start()
    with pytest.raises(InvalidInput, match=says):
        bus.call(SUBMIT, pb.SubmitRequest(instruction=MOVE, settings={name: text}), 5)


def test_an_unknown_class_is_refused_with_close_names(start: Start) -> None:
    _, bus, _ = start(names=("mug", "coffee table", "kitchen counter", "sofa"))
    with pytest.raises(InvalidInput, match=r"does not know the goal “unicorn”"):
        submit(bus, "bring the mug to the unicorn")
    with pytest.raises(InvalidInput, match="did you mean kitchen counter"):
        submit(bus, "bring the mug to the kitchen table counter top")
    assert not bus.call(LIST_TASKS, pb.Empty(), 5).tasks


def test_names_are_mapped_to_the_vocabulary(start: Start) -> None:
    _, bus, peers = start(names=("mug", "coffee table", "counter"))
    id = submit(bus, "bring the red coffee mug to the counter").id
    assert task(bus, id).object == "mug"
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).state in ("cancelled", "succeeded")
    assert peers.world.contacts == 0


def test_a_valid_task_succeeds_after_refused_nonsense(start: Start) -> None:
    _, bus, _ = start()
    for text in ("", "x" * 10_000, "the quick brown fox", "bring it"):
        with pytest.raises(InvalidInput):
            submit(bus, text)
    assert ended(bus, submit(bus, "go to the counter").id).state == "succeeded"


@pytest.mark.parametrize("bad", ["\x00", "\x1b[31m", "\x07", "\x85", "\u202e", "\u2028"])
def test_control_characters_are_refused_and_not_repeated(start: Start, bad: str) -> None:
    _, bus, _ = start()
    with pytest.raises(InvalidInput, match="holds the control character U") as refused:
        submit(bus, f"find the {bad}mug")
    assert refused.value.message.isprintable()
    assert not bus.call(LIST_TASKS, pb.Empty(), 5).tasks


def test_an_instruction_is_kept_on_one_line(start: Start) -> None:
    _, bus, _ = start()
    assert submit(bus, " find\tthe\r\n mug ").instruction == "find the mug"
