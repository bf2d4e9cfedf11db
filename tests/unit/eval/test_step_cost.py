"""Tests of the study `step_cost`: each part gets its own CPU time, and the parts add up."""

from __future__ import annotations

import time

import numpy as np
import pytest
from helios_eval.episodes.episode_spec import EpisodeSpec, noise_of
from helios_eval.studies import step_cost
from helios_eval.studies.cpu_parts import (
    DETECTOR,
    PARTS,
    PHYSICS,
    PLANNER,
    REST,
    PartClock,
    measure,
    summary,
)
from helios_eval.studies.step_cost import main, table


def busy() -> None:
    began = time.process_time()
    while time.process_time() - began < 0.02:
        pass


def test_the_time_of_a_part_within_another_counts_once() -> None:
    clock = PartClock()
    inner = clock.counted(busy, PHYSICS)

    def both() -> None:
        busy()
        inner()

    clock.counted(both, PLANNER)()
    clock.enter(REST)
    assert clock.seconds[PHYSICS] >= 0.02
    assert clock.seconds[PLANNER] >= 0.02
    assert clock.seconds[DETECTOR] == 0


def test_every_part_of_an_episode_has_a_cost() -> None:
    noise = noise_of("demo-v1", 1.0, None)
    asked = EpisodeSpec("ovmm", "helios", "noisy", "demo-v1", 0, noise, {"max_steps": 12})
    cost = measure(asked)
    assert cost.shape[1] == len(PARTS)
    means = dict(zip(PARTS, cost.mean(axis=0), strict=True))
    assert [part for part in PARTS if not means[part] > 0] == []
    assert means[REST] < 0.2 * sum(means.values())


def test_the_thirds_of_episodes_are_their_own_means() -> None:
    rising = np.arange(9.0)[:, None] * np.ones(len(PARTS))
    found = summary([rising, rising])
    assert found[PHYSICS] == {"all": 4.0, "first": 1.0, "last": 7.0}
    assert found["all"]["all"] == 4.0 * len(PARTS)
    assert "0.50" in table(found, {part: {"all": 8.0} for part in PARTS})


@pytest.mark.parametrize("wrong", [["--steps", "2"], ["--seeds", "a"], ["--agents", "nobody"]])
def test_wrong_use_ends_with_status_2(wrong: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_cost, "prepare", lambda: None)  # it would limit this process
    try:
        status = main(wrong)
    except SystemExit as ended:
        status = ended.code
    assert status == 2
