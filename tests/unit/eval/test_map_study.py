"""Tests the study that compares evidence rules of the object map on the same frames."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helios_client.usage_errors import UsageError
from helios_core.types import ObjectInstance, Role
from helios_eval.episodes.belief_truth import Role as BeliefRole
from helios_eval.episodes.belief_truth import judge_instances
from helios_eval.studies.evidence_rules import Outcome, arm_of, main, pick, row, tell
from helios_eval.studies.recorded_walk import Walk, believed, walk
from helios_sim.ground_truth import TrueObjectState

LOW: dict[Role, float] = dict.fromkeys(
    (Role.OBJECT, Role.START_RECEPTACLE, Role.GOAL_RECEPTACLE), 0.2
)


def object_instance(name: str, center_m: Sequence[float], size_m: Sequence[float], score: float):
    x, y, dx, dy = *center_m[:2], size_m[0] / 2, size_m[1] / 2
    corners = [(x - dx, y - dy), (x + dx, y - dy), (x + dx, y + dy), (x - dx, y + dy)]
    return ObjectInstance(
        id=1, class_name=name, center_m=np.array(center_m), size_m=np.array(size_m), score=score,
        class_score=score + 0.1, uncertainty=0.1, views=5, gaussians=50,
        probabilities={name: score}, top_m=center_m[2] + size_m[2] / 2,
        outline_m=np.array(corners), detection_rate=0.5,
    )  # fmt: skip


@pytest.fixture(scope="module")
def walked() -> Walk:
    return walk("demo-v1", 0, 60, 4, LOW)


def test_an_arm_is_an_agent_with_its_settings_and_the_given_overrides() -> None:
    paper, ours, other = (
        arm_of(t) for t in ("helios-paper", "helios", "helios size_agreement=on od_g=0.4")
    )
    assert (paper.map.evidence, ours.map.evidence) == ("views", "hindsight")
    assert (paper.by_place, ours.by_place) == (False, True)
    assert other.map.model_copy(update={"size_agreement": ours.map.size_agreement}) == ours.map
    assert other.thresholds == {**ours.thresholds, Role.OBJECT: 0.4}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "helios-paper or helios"),
        ("trusting", "helios-paper or helios"),
        ("helios voxels=2", "voxels"),
    ],
)
def test_an_invalid_arm_is_refused(text: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        arm_of(text)


@pytest.mark.parametrize("agent", ["helios-paper", "helios"])
def test_an_object_on_the_start_receptacle_is_picked_before_one_with_a_higher_score(
    agent: str,
) -> None:
    arm = arm_of(agent)
    table = object_instance("coffee table", (1.0, 1.0, 0.4), (1.0, 0.6, 0.1), score=0.4)
    there = object_instance("mug", (1.2, 1.0, 0.5), (0.1, 0.1, 0.1), score=0.3)
    elsewhere = object_instance("mug", (4.0, 4.0, 0.5), (0.1, 0.1, 0.1), score=0.6)
    true = TrueObjectState("mug_0", "mug", (1.2, 1.0, 0.5), (0.1, 0.1, 0.1), 0.0, True)
    task = Walk(0, "mug", "coffee table", "counter", (true,), (true,), ())
    assert pick(arm, task, [table, there, elsewhere]) is True
    assert pick(arm, task, [table, elsewhere]) is False
    assert pick(arm, task, [table, replace(there, class_score=0.05)]) is None


def test_an_arm_is_compared_with_the_first_home_by_home() -> None:
    first, other = Outcome([True, True, False, None]), Outcome([True, None, True, True])
    first.beliefs = other.beliefs = [[], [], [], []]
    figures = row(other, first)
    assert (figures["right"], figures["won"], figures["lost"]) == (3, 2, 1)
    assert (figures["wrong"], figures["none"]) == (0, 1)


def test_every_map_receives_the_same_frames_with_the_thresholds_of_its_arm(walked: Walk) -> None:
    arm = arm_of("helios-paper")
    known = believed(walked.seen, arm.map, arm.thresholds)
    again = believed(walked.seen, arm.map, arm.thresholds)
    assert [(o.id, o.score) for o in known] == [(o.id, o.score) for o in again]
    assert known
    assert not believed(walked.seen, arm.map, dict.fromkeys(LOW, 1.0))
    found = Outcome()
    tell(walked, [arm], {arm.name: found})
    roles: dict[str, BeliefRole] = {walked.goal: "goal", walked.start: "start"}
    roles[walked.object] = "object"
    assert found.beliefs == [judge_instances(known, walked.things, roles, len(walked.seen))]


def test_the_walk_picks_no_object_and_its_targets_are_of_the_task_class(walked: Walk) -> None:
    assert not any(one.held for one in walked.seen)
    assert {t.class_name for t in walked.targets} == {walked.object}


def test_the_command_prints_a_row_for_each_arm(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    arguments = ["--out", str(tmp_path), "--preset", "demo-v1", "--seed0", "0", "--homes", "1",
                 "--max-steps", "30"]  # fmt: skip
    assert main([*arguments, "--arm", "helios-paper", "--arm", "helios size_agreement=large"]) == 0
    printed = capsys.readouterr().out
    assert "| `helios-paper` | 1 |" in printed
    kept = json.loads((tmp_path / "study.json").read_text())
    assert list(kept) == ["helios-paper", "helios size_agreement=large"]
    assert main([*arguments, "--arm", "nobody"]) == 1
    assert "helios-paper or helios" in capsys.readouterr().err
