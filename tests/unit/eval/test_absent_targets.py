"""Tests tasks that ask for an object that is not in the home."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from eval_constructed_records import record
from helios_client.usage_errors import UsageError
from helios_core.name_rules import plain
from helios_detector.vocabulary_matching import accepted_names
from helios_eval.episodes import episode_record
from helios_eval.episodes.absent_targets import (
    PARTS,
    absent_classes,
    absent_episode_of,
    is_drawn,
)
from helios_eval.episodes.episode_judgement import Verdict, episode_for, verdict
from helios_eval.episodes.episode_player import play
from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.episodes.episode_spec import WALKER, EpisodeSpec, noise_of
from helios_eval.episodes.run_conditions import Condition, parse_condition
from helios_eval.report import write_report
from helios_eval.report.agent_groups import arms_of, in_common
from helios_eval.report.failure_causes import film, replay
from helios_eval.report.record_metrics import values
from helios_eval.runs import merge_runs, results
from helios_eval.runs.evaluation_run import failed_record
from helios_sim.episode_events import PickTried
from helios_sim.episode_tracker import episode_of, navigable_area_of, targets_of
from helios_sim.failure_causes import AgentReport
from helios_sim.home import PRESETS, Episode, Home, generate_home
from helios_sim.home.catalogs import CATALOGS
from helios_sim.home.color_palette import draw_palette
from helios_sim.home.task_sampling import ROLLING, sample_absent
from helios_sim.ovmm_metrics import Progress
from hypothesis import given
from hypothesis import strategies as st

HOMES = (("demo-v1", 0), ("demo-v1", 1), ("ovmm-v1", 3))
NOT_FOUND: dict[str, Any] = {"state": "failed", "reported_cause": "object not found"}


@pytest.fixture(scope="module", params=HOMES, ids=lambda home: f"{home[0]}-{home[1]}")
def home(request: pytest.FixtureRequest) -> Home:
    preset, seed = request.param
    return generate_home(seed, PRESETS[preset])


@pytest.fixture(scope="module")
def demo_home() -> Home:
    return generate_home(0, PRESETS["demo-v1"])


# --- the draws ------------------------------------------------------------------------------------
def test_the_share_of_drawn_homes_is_the_given_one() -> None:
    for share in (0.1, 0.25, 0.6):
        drawn = sum(is_drawn(seed, share) for seed in range(4000)) / 4000
        assert drawn == pytest.approx(share, abs=0.03)
    assert not any(is_drawn(seed, 0.0) for seed in range(500))
    assert all(is_drawn(seed, 1.0) for seed in range(500))


def test_no_task_asks_for_an_absent_object_of_a_class_that_always_rolls() -> None:
    rng = np.random.default_rng(0)
    always = {
        name
        for catalog in CATALOGS.values()
        for name, (make, _) in catalog.objects.items()
        if all(make(rng, draw_palette(rng)).rolls for _ in range(8))
    }
    assert always == ROLLING
    home = generate_home(3, PRESETS["ovmm-v1"])
    likely = dict.fromkeys((*ROLLING, "mug"), ("desk",))
    drawn = {sample_absent(home.receptacles, likely, rng).object_class for _ in range(20)}
    assert drawn == {"mug"}


@given(seed=st.integers(0, 200_000), share=st.floats(0, 1), more=st.floats(0, 1))
def test_a_draw_is_repeatable_and_a_larger_share_keeps_it(
    seed: int, share: float, more: float
) -> None:
    assert is_drawn(seed, share) == is_drawn(seed, share)
    if is_drawn(seed, share):
        assert is_drawn(seed, max(share, more))


def test_all_agents_and_a_single_replayed_home_share_the_draw() -> None:
    specs = [
        EpisodeSpec("ovmm", agent, "noisy", "demo-v1", seed, None, {"absent": 0.5})
        for seed in range(40)
        for agent in ("helios", "trusting")
    ]
    drawn = [spec.target_absent for spec in specs]
    assert drawn[::2] == drawn[1::2]
    assert {True, False} == set(drawn)
    assert not any(replace(spec, settings={}).target_absent for spec in specs)


# --- the class ------------------------------------------------------------------------------------
def test_the_asked_class_is_not_in_the_home_under_any_name(home: Home) -> None:
    things = (*home.objects, *home.receptacles, *home.fixtures)
    there = {plain(thing.class_name) for thing in things}
    tasks = [absent_episode_of(home, seed) for seed in range(30)]
    assert tasks == [absent_episode_of(home, seed) for seed in range(30)]
    assert len({task.object_class for task in tasks}) > 1
    hosts = {receptacle.class_name for receptacle in home.receptacles}
    for task in tasks:
        assert task.absent
        asked = plain(task.object_class)
        assert there.isdisjoint(accepted_names(asked))
        assert all(asked not in accepted_names(name) for name in there)
        assert {task.start_receptacle_class, task.goal_receptacle_class} <= hosts
        assert task.start_receptacle_class != task.goal_receptacle_class
        assert task.instruction == (
            f"Move the {task.object_class} from the {task.start_receptacle_class} "
            f"to the {task.goal_receptacle_class}"
        )


def test_no_task_asks_for_an_absent_object_that_the_shapes_of_furniture_show() -> None:
    shown = set[str]()
    for seed in range(6):
        home = generate_home(seed, PRESETS["ovmm-v1"])
        there = {thing.class_name for thing in (*home.receptacles, *home.fixtures)}
        parts = {part for name in there for part in PARTS.get(name, ())}
        shown |= parts - {thing.class_name for thing in home.objects}
        assert parts.isdisjoint(absent_classes(home))
    assert shown  # some are absent as objects


def test_an_absent_task_has_goals_and_no_candidate(demo_home: Home) -> None:
    ground = navigable_area_of(demo_home, 0.3)
    targets = targets_of(demo_home, absent_episode_of(demo_home, 0), ground)
    assert not targets.objects
    assert targets.goals


@pytest.mark.parametrize(
    ("there", "asked"),
    [
        ("photo frame", "picture frame"),
        ("sneaker", "shoe"),
        ("tennis ball", "ball"),
        ("Remote_Control", "remote control"),
        ("pitcher", "jug"),
    ],
)
def test_a_synonym_or_a_narrower_name_in_the_home_excludes_a_class(there: str, asked: str) -> None:
    thing, empty = SimpleNamespace(class_name=there), {"receptacles": (), "fixtures": ()}
    bare = SimpleNamespace(objects=(), preset=PRESETS["ovmm-v1"], **empty)
    furnished = SimpleNamespace(objects=(thing,), preset=PRESETS["ovmm-v1"], **empty)
    assert asked in absent_classes(cast(Home, bare))
    assert asked not in absent_classes(cast(Home, furnished))


def test_the_ordinary_task_of_a_home_does_not_change(demo_home: Home) -> None:
    assert episode_for("ovmm", demo_home, 0) == episode_of(demo_home, 0)
    assert not episode_for("ovmm", demo_home, 0).absent
    assert episode_for("ovmm", demo_home, 0, True) == absent_episode_of(demo_home, 0)


# --- the judgement --------------------------------------------------------------------------------
WRONG = PickTried(40, 10.0, "mug", at_candidate=False, name="vase_0", candidate=False)


def judged(
    said: AgentReport, steps: int = 80, picked: bool = False, away_m: float = 1.0, held: str = ""
) -> Verdict:
    """away_m: from its first place, of the vase that was picked."""
    vase = SimpleNamespace(name="vase_0", position_m=(2.0, 1.0, 0.8))
    world: Any = SimpleNamespace(
        progress=Progress(steps=steps, path_m=20.0),
        events=[WRONG] if picked else [],
        home=SimpleNamespace(objects=(vase,)),
        held_name=held,
        position_m=lambda name: np.array([2.0 + away_m, 1.0, 0.8]),
        episode=Episode("mug", "desk", "bed", "Move the mug from the desk to the bed", True),
    )
    return verdict("ovmm", world, said, 1250)


def test_an_absent_task_succeeds_by_the_report_not_found_alone() -> None:
    gave_up = AgentReport("failed", "object not found", "no mug was found")
    assert judged(gave_up) == Verdict(False, False, False, False, True, "")
    moved = judged(gave_up, picked=True)
    assert (moved.success, moved.cause) == (False, "wrong object believed")
    assert judged(gave_up, picked=True, away_m=0.1).success  # it was looked at and put back
    assert judged(gave_up, picked=True, away_m=0.1, held="vase_0").cause == "wrong object believed"
    spent = judged(AgentReport("failed", "step budget", "1250 steps are used up"), 1250)
    assert (spent.success, spent.cause) == (False, "step budget")
    placed = judged(AgentReport("succeeded"), picked=True)
    assert (placed.success, placed.cause) == (False, "wrong object believed")


def test_the_walker_reports_an_absent_object_at_once() -> None:
    spec = EpisodeSpec(
        "ovmm", WALKER, "noisy", "demo-v1", 0, noise_of("demo-v1", 1.0, None), {"absent": 1.0}
    )
    played = play(spec, "here").record
    assert (played.absent, played.success, played.cause, played.steps) == (True, True, "", 0)
    assert played.not_found
    assert played.key == spec.key


def test_an_agent_without_steps_does_not_answer_an_absent_task() -> None:
    spec = EpisodeSpec(
        "ovmm",
        "helios",
        "noisy",
        "demo-v1",
        0,
        noise_of("demo-v1", 1.0, None),
        {"absent": 1.0, "max_steps": 3},
    )
    played = play(spec, "here")
    assert (played.record.absent, played.record.success) == (True, False)
    assert (played.record.cause, played.record.reported_cause) == ("step budget", "step budget")
    assert played.snapshot is not None
    assert not played.snapshot.candidates


# --- flags and records ----------------------------------------------------------------------------
def condition(benchmark: str = "ovmm", **more: Any) -> Condition:
    return parse_condition(
        ["helios"], benchmark, semantics="noisy", preset="demo-v1", table=None, level=1.0,
        correlation=None, sensor="none", assignments=[], max_steps=None, scorer=None, **more,
    )  # fmt: skip


def test_the_settings_of_an_episode_name_the_share_only_where_it_is_not_0() -> None:
    assert condition(absent=0.25).settings["absent"] == 0.25
    assert "absent" not in condition(absent=0.0).settings
    assert "absent" not in condition().settings
    for share in (-0.1, 1.1, float("nan")):
        with pytest.raises(UsageError, match="--absent"):
            condition(absent=share)
    with pytest.raises(UsageError, match="moves no object"):
        condition("objectnav", absent=0.25)


def test_a_record_written_before_this_flag_is_read_with_the_same_key(tmp_path: Path) -> None:
    now = record(3, settings={"detector.scorer": "lexical"})
    line = json.loads(now.model_dump_json())
    del line["absent"], line["reported_cause"]
    (tmp_path / episode_record.EPISODES).write_text(json.dumps(line) + "\n")
    (old,) = episode_record.read(tmp_path)
    assert old == now
    assert old.key == now.key
    assert not old.absent
    assert "absent" not in old.key


def test_a_record_of_an_absent_target_outlives_writing_and_packing(tmp_path: Path) -> None:
    kept = record(3, settings={"absent": 1.0}, absent=True, **NOT_FOUND)
    (tmp_path / "run").mkdir()
    episode_record.append(tmp_path / "run", kept)
    assert episode_record.read(tmp_path / "run") == [kept]
    merge_runs.pack(tmp_path / "packed", [kept], {})
    (read,) = episode_record.read(tmp_path / "packed")
    assert (read.key, read.absent, read.not_found) == (kept.key, True, True)


def test_an_episode_that_could_not_be_played_keeps_its_absent_target() -> None:
    for seed in range(20):
        spec = EpisodeSpec("ovmm", "helios", "noisy", "demo-v1", seed, None, {"absent": 0.5})
        assert failed_record(spec, "broken", "here").absent == spec.target_absent


def test_the_commands_that_play_and_film_an_episode_again_name_the_share() -> None:
    kept = record(3, settings={"absent": 0.25, "detector.scorer": "simulated:itc-v1"})
    assert "--absent 0.25" in replay(kept)
    assert "--absent 0.25" in film(kept)
    assert "--absent" not in replay(record(3))


# --- metrics and report ---------------------------------------------------------------------------
def outcome(seed: int, absent: bool, agent: str = "helios-paper", **more: Any) -> EpisodeRecord:
    lost = {
        "find_object": False,
        "pick": False,
        "find_receptacle": False,
        "place": False,
        "success": False,
        "cause": "step budget",
        "state": "failed",
    }
    settings = {"absent": 0.5, "detector.scorer": "lexical"}
    chosen = lost | {"absent": absent, "agent": agent, "settings": settings} | more
    return record(seed, **chosen)


WON: dict[str, Any] = {
    "find_object": True,
    "pick": True,
    "find_receptacle": True,
    "place": True,
    "success": True,
    "cause": "",
    "state": "succeeded",
}
RIGHT = NOT_FOUND | {"success": True, "cause": ""}


def mixed(agent: str = "helios-paper") -> list[EpisodeRecord]:
    """Four present targets: 2 successes, 1 false "not found", 1 step budget. Four absent ones: 1
    right "not found", 1 wrong object, 1 failed pick without a grasp, 1 step budget."""
    present = [WON, WON, NOT_FOUND | {"cause": "object not found"}, {}]
    wrong = {"cause": "wrong object believed", "reported_cause": "pick failed", "picks": 1}
    absent = [RIGHT, wrong | {"wrong_picks": 1}, wrong | {"wrong_picks": 0}, {}]
    return [outcome(seed, False, agent, **facts) for seed, facts in enumerate(present)] + [
        outcome(4 + seed, True, agent, **facts) for seed, facts in enumerate(absent)
    ]


def row(markdown: str, title: str) -> list[str]:
    """Cells of the first row of a table, without intervals."""
    lines = markdown[markdown.index(f"### {title}\n") :].splitlines()
    cells = next(line for line in lines if line.startswith("| helios-paper")).strip("| ")
    return [re.sub(r" *\(.*\)|\*", "", cell).strip() for cell in cells.split(" | ")]


def test_phases_are_means_over_present_targets_and_success_is_over_all() -> None:
    episodes = mixed()
    assert values(episodes, "SR").tolist() == [1, 1, 0, 0, 1, 0, 0, 0]
    for name in ("FindObj", "Pick", "FindRec", "Place", "partial"):
        assert values(episodes, name).tolist() == [1, 1, 0, 0]
    means = results.metrics(episodes, "unlimited")
    assert (means["SR"]["mean"], means["SR"]["n"]) == (3 / 8, 8)
    assert (means["FindObj"]["mean"], means["FindObj"]["n"]) == (0.5, 4)


def test_the_report_has_a_table_of_present_and_absent_targets(tmp_path: Path) -> None:
    for r in mixed():
        episode_record.append(tmp_path, r)
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert row(markdown, "Present and absent targets")[1:] == [
        "37.5",
        "50.0",
        "25.0",
        "4",
        "25.0",
        "25.0",
        "25.0",
        "4",
    ]
    assert "4 of 8 episodes (--absent 0.5)" in markdown.replace("\\", "")
    assert "the episodes with a present target alone" in markdown
    assert "the agent reports that it found no object" in markdown


def test_a_report_without_absent_targets_does_not_mention_them(tmp_path: Path) -> None:
    episode_record.append(tmp_path, record(0))
    write_report(tmp_path)
    assert "absent" not in (tmp_path / "report.md").read_text()


def test_a_report_of_absent_targets_alone_has_no_phases(tmp_path: Path) -> None:
    for agent in ("helios-paper", "trusting"):
        for r in mixed(agent)[4:]:
            episode_record.append(tmp_path, r)
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert row(markdown, "Present and absent targets")[1:] == [
        "25.0",
        "–",
        "–",
        "0",
        "25.0",
        "25.0",
        "25.0",
        "4",
    ]
    assert "nan" not in markdown.lower()
    written = results.rows(episode_record.read(tmp_path), ["unlimited"])
    assert written[0]["metrics"]["FindObj"] == {"mean": None, "sem": None, "n": 0}
    json.dumps(written, allow_nan=False)


def test_agents_are_compared_only_where_both_had_the_same_kind_of_task() -> None:
    without = [record(seed, settings={"detector.scorer": "lexical"}) for seed in range(8)]
    arms = arms_of([*mixed(), *without])
    assert len(arms) == 2
    assert len({arm.condition for arm in arms}) == 2
    first, second = in_common(*arms)
    assert [r.seed for r in first] == [r.seed for r in second] == [0, 1, 2, 3]
