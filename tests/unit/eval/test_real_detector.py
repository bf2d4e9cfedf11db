"""Tests evaluations with a real detector: options, identity of the model, classes of the tasks."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from eval_constructed_records import record
from helios_client.usage_errors import UsageError
from helios_core.errors import InvalidInput, Unavailable
from helios_core.models.model_folder import LockedFile, LockedModel, write_lock
from helios_detector.coco_classes import COCO_NAMES
from helios_eval.episodes import episode_spec, task_classes
from helios_eval.episodes.episode_judgement import episode_for
from helios_eval.episodes.episode_player import PlayedEpisode, play
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.episodes.home_presets import home_of
from helios_eval.episodes.real_detector import digest_of, real_detector
from helios_eval.episodes.run_conditions import Condition, parse_condition
from helios_eval.episodes.task_classes import TaskClasses
from helios_eval.episodes.worker import Skipped
from helios_eval.report.failure_causes import replay
from helios_eval.report.report_builder import build
from helios_eval.runs import evaluation_run as runs
from helios_eval.runs.evaluation_run import Run, run
from helios_eval.runs.process_pool import Outcome
from helios_eval.studies.realism_judging import PARAMETRIC, Row, names_for
from helios_eval.studies.recognised_classes import has_own_name, upper_half, write_classes
from helios_sim.home.catalogs import CATALOGS
from helios_sim.home.task_sampling import NoTask
from rich.console import Console

from tests.unit.detector.tiny_onnx import yolox

BOX = (100.0, 100.0, 160.0, 180.0)
OBJECTS = '"remote control" = "remote"'
HOSTS = 'sofa = "couch"\n"TV stand" = "tv"\n"coffee table" = "dining table"'
COUCH = COCO_NAMES.index("couch")


def model(path: Path, score: float = 0.9) -> Path:
    """A model that finds one couch in every image."""
    return yolox(path, [(BOX, COUCH, score)], len(COCO_NAMES))


def condition(detector: str | None, semantics: str = "detector", **more: Any) -> Condition:
    given: dict[str, Any] = {
        "benchmark": "ovmm", "scorer": None, "task_classes": "all", "table": None, "level": 1.0,
        "correlation": None, "assignments": [],
    }  # fmt: skip
    given |= more
    return parse_condition(
        ["helios-paper"], given.pop("benchmark"), semantics=semantics, preset="demo-v1",
        sensor="none", max_steps=None, detector=detector, **given,
    )  # fmt: skip


def spec_of(under: Condition, seed: int = 0, steps: int = 3) -> EpisodeSpec:
    settings = {**under.settings, "max_steps": steps}
    return EpisodeSpec(
        "ovmm", "helios-paper", "detector", under.preset, seed, None, settings, under.inputs
    )


# --- options --------------------------------------------------------------------------------------
def test_a_fetched_model_is_named_by_its_file_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = tmp_path / "models" / "onnx" / "yolox_nano.onnx"
    stored.parent.mkdir(parents=True)
    size = model(stored).stat().st_size
    lock = LockedModel("", "", "", "", {stored.name: LockedFile(size, "", "first download")})
    write_lock(tmp_path / "models", {stored.name: lock})
    monkeypatch.setenv("HELIOS_MODELS", str(tmp_path / "models"))
    monkeypatch.chdir(tmp_path)
    fetched = real_detector(f"onnx:{stored.name}")
    assert fetched == real_detector(f"onnx:{stored}")
    fetched.check()


@pytest.mark.parametrize(
    ("detector", "more", "said"),
    [
        (None, {}, "add --detector onnx:FILE"),
        ("onnx:FILE", {"semantics": "noisy"}, "add --semantics detector"),
        ("simulated", {}, "no real detector"),
        ("onnx:/no/model.onnx", {}, "is no file"),
        ("onnx:FILE", {"benchmark": "objectnav", "task_classes": None}, "is for --benchmark ovmm"),
        ("onnx:FILE", {"task_classes": None}, "--task-classes all"),
        ("onnx:FILE", {"task_classes": "nothing"}, "wanted all, a TOML file, or yolox_nano"),
        ("onnx:FILE", {"task_classes": "yolox_nano"}, "is of the model e8af"),
    ],
)
def test_options_that_do_not_fit_are_usage_errors(
    detector: str | None, more: dict[str, Any], said: str, tmp_path: Path
) -> None:
    spec = detector and detector.replace("FILE", str(model(tmp_path / "tiny.onnx")))
    with pytest.raises(UsageError, match=said):
        condition(spec, **more)


def test_a_real_detector_comes_with_the_scorer_that_has_no_simulated_error(tmp_path: Path) -> None:
    spec = f"onnx:{model(tmp_path / 'tiny.onnx')}"
    assert condition(spec).settings[episode_spec.SCORER] == "lexical"
    said = condition(spec, scorer="simulated:itc-v1")
    assert said.settings[episode_spec.SCORER] == "simulated:itc-v1"


def test_a_record_names_the_detector_by_its_content_not_by_its_folder(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
    same = [model(tmp_path / folder / "tiny.onnx") for folder in "ab"]
    other = model(tmp_path / "c" / "tiny.onnx", 0.8)
    names = [condition(f"onnx:{p}").settings[episode_spec.DETECTOR] for p in (*same, other)]
    assert names[0] == names[1] != names[2]
    assert str(names[0]).startswith("onnx:tiny.onnx@")


def test_class_names_beside_the_file_are_part_of_the_detector(tmp_path: Path) -> None:
    path = model(tmp_path / "tiny.onnx")
    before = condition(f"onnx:{path}").settings
    (tmp_path / "tiny.txt").write_text("\n".join(COCO_NAMES))
    assert condition(f"onnx:{path}").settings != before


def test_the_command_that_plays_an_episode_again_names_the_detector_without_its_digest() -> None:
    found = {episode_spec.DETECTOR: "onnx:tiny.onnx@0123"}
    for settings in (found, found | {"detector.scorer": "lexical"}):
        again = replay(record(3, semantics="detector", noise=None, settings=settings))
        assert "--detector onnx:tiny.onnx " in again
        assert "--task-classes all" in again
        assert "scorer" not in again


def test_tasks_in_the_words_of_a_detector_have_no_pick_rule_by_the_names_of_the_home(
    tmp_path: Path,
) -> None:
    detector = f"onnx:{model(tmp_path / 'tiny.onnx')}"
    classes = tmp_path / "mine.toml"
    classes.write_text(f"[parametric.objects]\n{OBJECTS}\n[parametric.receptacles]\n{HOSTS}")
    with pytest.raises(UsageError, match="leave --pick-rule out"):
        condition(detector, task_classes=str(classes), pick_rule="ovmm")


@pytest.mark.parametrize("semantics", ["detector", "ground-truth"])
@pytest.mark.parametrize(
    ("flag", "given"),
    [
        ("--noise ", {"table": "ovmm-v1"}),
        ("--noise-level", {"level": 3.0}),
        ("--noise-correlation", {"correlation": 0.9}),
    ],
)
def test_flags_of_the_simulated_errors_are_refused_where_they_have_no_effect(
    tmp_path: Path, semantics: str, flag: str, given: dict[str, Any]
) -> None:
    real = semantics == "detector"
    detector = f"onnx:{model(tmp_path / 'tiny.onnx')}" if real else None
    said = f"{flag.strip()} has no effect with --semantics {semantics}"
    with pytest.raises(UsageError, match=said):
        condition(detector, semantics, task_classes="all" if real else None, **given)


@pytest.mark.parametrize("semantics", ["noisy", "ground-truth"])
def test_settings_of_the_detector_are_refused_where_it_is_simulated(semantics: str) -> None:
    """Else they would make another arm with the same results."""
    said = f"detector.depth has no effect with --semantics {semantics}"
    with pytest.raises(UsageError, match=said):
        condition(None, semantics, task_classes=None, assignments=["depth=none"])


# --- the stack ------------------------------------------------------------------------------------
def test_the_stack_works_with_the_detections_of_the_model(tmp_path: Path) -> None:
    classes = tmp_path / "mine.toml"
    classes.write_text(f"[parametric.objects]\n{OBJECTS}\n[parametric.receptacles]\n{HOSTS}")
    under = condition(f"onnx:{model(tmp_path / 'tiny.onnx')}", task_classes=str(classes))
    played = play(spec_of(under), "here").record
    assert played.instruction.startswith("Move the remote from the couch to the ")
    assert played.object_class == "remote control"
    assert (played.semantics, played.noise, played.steps) == ("detector", None, 3)
    assert "detector_detect" in played.stage_ms
    assert "world_segmentation" not in played.stage_ms  # no ground truth is rendered for it


def test_an_episode_refuses_a_file_that_changed_after_the_start_of_the_run(tmp_path: Path) -> None:
    path = model(tmp_path / "tiny.onnx")
    under = condition(f"onnx:{path}")
    model(path, 0.5)
    with pytest.raises(Unavailable, match="has changed since the run began"):
        play(spec_of(under), "here")


def test_a_large_model_is_read_again_only_if_it_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "tiny.onnx"
    path.write_bytes(b"weights")
    first = digest_of(path)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", lambda *_: pytest.fail("the file was read again"))
        assert digest_of(path) == first == hashlib.sha256(b"weights").hexdigest()
    path.write_bytes(b"other weights")
    assert digest_of(path) == hashlib.sha256(b"other weights").hexdigest()


# --- runs -----------------------------------------------------------------------------------------
class FakePool:
    """Plays nothing; homes with an odd seed have no task."""

    def __init__(self) -> None:
        self.seeds: list[int] = []

    def outcomes(self, _: Run, missing: Sequence[EpisodeSpec], __: str) -> Generator[Outcome]:
        for spec in missing:
            self.seeds.append(spec.seed)
            if spec.seed % 2:
                yield spec, Skipped("no object of the allowed classes")
            else:
                made = record(
                    spec.seed,
                    semantics="detector",
                    preset=spec.preset,
                    noise=None,
                    settings=spec.settings,
                    preset_hash=runs.home_presets.digest_of(spec.preset),
                )
                yield spec, PlayedEpisode(made)


@pytest.fixture
def fake_pool(monkeypatch: pytest.MonkeyPatch) -> FakePool:
    pool = FakePool()
    monkeypatch.setattr(runs, "_outcomes", pool.outcomes)
    return pool


def asked(under: Condition, out: Path) -> Run:
    return Run(
        "ovmm", under.agents, ("unlimited",), "detector", under.preset, 4, 0, out, 1, None,
        under.settings, inputs=under.inputs,
    )  # fmt: skip


def test_a_run_continues_with_the_same_file_only(fake_pool: FakePool, tmp_path: Path) -> None:
    path, out = model(tmp_path / "tiny.onnx"), tmp_path / "out"
    run(asked(condition(f"onnx:{path}"), out), Console(quiet=True))
    run(asked(condition(f"onnx:{path}"), out), Console(quiet=True))
    assert fake_pool.seeds == [0, 1, 2, 3]
    model(path, 0.5)
    with pytest.raises(InvalidInput, match=r"another file of the detector \(onnx:tiny.onnx@"):
        run(asked(condition(f"onnx:{path}"), out), Console(quiet=True))


def test_homes_without_a_task_are_named_and_do_not_count_as_missing(
    fake_pool: FakePool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    under = condition(f"onnx:{model(tmp_path / 'tiny.onnx')}")
    assert len(run(asked(under, tmp_path / "out"), Console(width=200))) == 2
    said = "2 of 4 homes have no task of the allowed classes and were skipped (seeds 1, 3)"
    assert said in capsys.readouterr().out
    report = (tmp_path / "out" / "report.md").read_text()
    assert said in report
    assert "Not complete" not in report
    assert "onnx:tiny.onnx@" in report
    described = json.loads((tmp_path / "out" / "run.json").read_text())
    assert list(described["without_task"].values()) == [[1, 3]]


@pytest.mark.usefixtures("fake_pool")
def test_a_run_of_homes_without_a_task_writes_empty_results(tmp_path: Path) -> None:
    under = condition(f"onnx:{model(tmp_path / 'tiny.onnx')}")
    only = replace(asked(under, tmp_path / "out"), episodes=1, seed0=1)
    assert run(only, Console(quiet=True)) == []
    assert json.loads((tmp_path / "out" / "results.json").read_text()) == []


# --- classes of the tasks -------------------------------------------------------------------------
def test_tasks_ask_for_allowed_classes_only() -> None:
    home = home_of("demo-v1", 0)
    hosts = {r.name: r.class_name for r in home.receptacles}
    thing = next(
        o
        for o in home.objects
        if not o.shape.rolls and hosts[o.receptacle] not in ("chair", "lamp")
    )
    receptacles = tuple(sorted({*hosts.values()}))
    classes = TaskClasses(
        "mine@0", {thing.class_name: "thing"}, {name: f"my {name}" for name in receptacles}
    )
    for seed in range(8):
        task = episode_for("ovmm", home, seed, False, classes)
        assert task.object_class == thing.class_name
        assert task.instruction.startswith("Move the thing from the my ")
        assert task.start_receptacle_class != task.goal_receptacle_class
        assert {task.start_receptacle_class, task.goal_receptacle_class} <= set(receptacles)


def test_a_home_without_an_allowed_task_says_so() -> None:
    with pytest.raises(NoTask, match="take another home"):
        episode_for("ovmm", home_of("demo-v1", 0), 0, False, TaskClasses("x@0", {"yak": "yak"}, {}))


@pytest.mark.parametrize("preset", ["ovmm-v1", "ovmm-v1+sweethome3d"])
def test_a_committed_table_names_classes_of_the_catalog_and_its_model(preset: str) -> None:
    found = task_classes.task_classes_for("yolox_nano", preset, None)
    assert found is not None
    assert set(found.objects) <= CATALOGS["ovmm"].objects.keys()
    assert set(found.receptacles) <= CATALOGS["ovmm"].receptacles.keys()


def test_a_table_without_these_looks_is_a_usage_error(tmp_path: Path) -> None:
    table = tmp_path / "mine.toml"
    table.write_text(f"[parametric.objects]\n{OBJECTS}\n[parametric.receptacles]\n{HOSTS}\n")
    with pytest.raises(UsageError, match=r"no part \[realistic\]"):
        task_classes.task_classes_for(str(table), "ovmm-v1+sweethome3d", None)


def test_the_upper_half_begins_at_the_median() -> None:
    assert upper_half({"a": 0.9, "b": 0.5, "c": 0.1}) == ["a", "b"]


def test_a_class_that_counts_under_the_name_of_another_is_no_class_of_tasks() -> None:
    assert has_own_name("sofa", {"couch"})
    assert not has_own_name("armchair", {"chair", "couch"})


def test_a_written_table_is_read_again(tmp_path: Path) -> None:
    rates = {"mug": 9, "vase": 1, "sofa": 8, "bench": 2, "armchair": 9}
    rows = {(name, PARAMETRIC): Row(10, n, ()) for name, n in rates.items()}
    right = {name: names_for(name, COCO_NAMES) for name in rates}
    path = tmp_path / "mine.toml"
    write_classes(path, rows, right, CATALOGS["ovmm"], {"sha256": "12"})
    found = task_classes.task_classes_for(str(path), "ovmm-v1", None)
    assert found is not None
    assert (found.objects, found.receptacles) == ({"mug": "cup"}, {"sofa": "couch"})
    assert found.name.startswith("mine@")


# --- report ---------------------------------------------------------------------------------------
@pytest.mark.parametrize(("task_classes_name", "compared"), [("yolox_nano@0", False), ("", True)])
def test_tasks_of_chosen_classes_do_not_answer_the_questions_of_the_paper(
    task_classes_name: str, compared: bool, tmp_path: Path
) -> None:
    settings = {episode_spec.TASK_CLASSES: task_classes_name} if task_classes_name else {}
    records = [
        record(seed, agent=agent, settings=settings)
        for agent in ("helios-paper", "trusting")
        for seed in range(8)
    ]
    report = build(tmp_path, records, {})
    titles = [section.title for section in report.sections]
    assert ("The questions and their answers" in titles) is compared
    assert ("Beside the paper" in titles) is compared
    glance = next(s for s in report.sections if s.title == "At a glance")
    assert ("The paper has no conditions like these" in str(glance)) is not compared


def test_a_run_beside_chosen_classes_is_still_compared(tmp_path: Path) -> None:
    chosen = {episode_spec.TASK_CLASSES: "yolox_nano@0"}
    records = [record(seed, settings=settings) for settings in ({}, chosen) for seed in range(8)]
    report = build(tmp_path, records, {})
    (beside,) = [section for section in report.sections if section.title == "Beside the paper"]
    assert "Table 1" in str(beside)


def test_agents_that_the_paper_lacks_are_not_shown_beside_it(tmp_path: Path) -> None:
    records = [record(seed, agent="random-frontier") for seed in range(8)]
    assert "Beside the paper" not in [s.title for s in build(tmp_path, records, {}).sections]
