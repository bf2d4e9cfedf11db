"""`--homes`: episodes in homes that people drew."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from helios_client import cli
from helios_client.usage_errors import UsageError
from helios_core.errors import InvalidInput, Unavailable
from helios_eval.episodes.episode_player import play
from helios_eval.episodes.episode_record import Benchmark, Setting
from helios_eval.episodes.episode_spec import WALKER, EpisodeSpec
from helios_eval.episodes.plan_homes import plan_homes
from helios_eval.episodes.run_conditions import parse_condition
from helios_eval.episodes.worker import Skipped, play_safely
from helios_eval.report.failure_causes import replay
from helios_eval.runs.evaluation_run import (
    Run,
    check_goes_on,
    failed_record,
    write_run_description,
)
from helios_sim.plans.plan_source import file_sha256

from scripts.generate_example_flat import OUT as FLAT
from tests.unit.sim.plan_files import LEFT, TWO_ROOMS, door, piece, room, write_plan


def _parse(homes: Path | None, level: str = "", preset: str = "ovmm-v1"):
    return parse_condition(
        [WALKER], "ovmm", semantics="ground-truth", preset=preset, table=None, level=1.0,
        correlation=None, sensor="none", assignments=(), max_steps=None, scorer=None, homes=homes,
        home_level=level,
    )  # fmt: skip


def _small(path: Path) -> Path:
    table, stand = piece("Table", 200, 250, (120, 80, 75)), piece("Desk", 600, 250, (120, 70, 74))
    return write_plan(path, (TWO_ROOMS, room("Kitchen", LEFT), door(400, 250), table, stand))


def test_a_record_carries_the_name_and_the_digest_of_its_plan(tmp_path: Path) -> None:
    plan = _small(tmp_path / "flat.sh3d")
    under = _parse(plan)
    spec = EpisodeSpec("ovmm", WALKER, "ground-truth", under.preset, 3, None, {}, under.inputs)
    assert spec.home_file == f"flat.sh3d sha256:{file_sha256(plan)}"
    assert under.preset == f"flat.sh3d@{file_sha256(plan)[:12]}"
    assert spec.max_steps == 1250
    record = play(spec, "here").record
    assert record.success
    assert record.home_file == spec.home_file
    assert record.preset_hash == file_sha256(plan)
    assert "--homes flat.sh3d" in replay(record)


@pytest.mark.parametrize(("benchmark", "absent"), [("objectnav", 0.0), ("ovmm", 1.0)])
def test_a_plan_without_a_task_of_the_wanted_kind_is_skipped(
    benchmark: Benchmark, absent: float, tmp_path: Path
) -> None:
    under = _parse(write_plan(tmp_path / "bare.sh3d", (TWO_ROOMS, door(400, 250))))
    settings: dict[str, Setting] = {"absent": absent} if absent else {}
    spec = EpisodeSpec(
        benchmark, WALKER, "ground-truth", under.preset, 3, None, settings, under.inputs
    )
    assert isinstance(play_safely(spec, "here"), Skipped)


def test_a_folder_of_plans_takes_turns(tmp_path: Path) -> None:
    first, second = _small(tmp_path / "a.sh3d"), tmp_path / "b.sh3d"
    shutil.copy(FLAT, second)
    (tmp_path / "notes.txt").write_text("no plan")
    homes = plan_homes(tmp_path)
    assert [homes.source_of(seed).path for seed in range(4)] == [first, second] * 2
    assert homes.kind.startswith(f"{tmp_path.name}@")
    before = homes.digest
    write_plan(first, (TWO_ROOMS, room("Bath", LEFT)))
    assert plan_homes(tmp_path).digest != before
    with pytest.raises(Unavailable, match="no longer the file"):
        homes.home_of(2)


def test_flags_that_contradict_each_other_and_plans_that_cannot_be_used(tmp_path: Path) -> None:
    for homes, level, preset, said in (
        (FLAT, "", "demo-v1", "leave one of them out"),
        (None, "Attic", "ovmm-v1", "--homes FILE"),
        (tmp_path, "", "ovmm-v1", "no .sh3d file"),
        (FLAT, "Attic", "ovmm-v1", "has no level"),
        (tmp_path / "none.sh3d", "", "ovmm-v1", "does not exist"),
    ):
        with pytest.raises(UsageError, match=said):
            _parse(homes, level, preset)


def test_a_run_names_its_plan_and_goes_on_only_with_the_same_content(tmp_path: Path) -> None:
    plan = _small(tmp_path / "a.sh3d")
    under = _parse(plan)
    asked = Run(
        "ovmm", under.agents, ("unlimited",), "ground-truth", under.preset, 1, 5, tmp_path, 1, None,
        under.settings, inputs=under.inputs,
    )  # fmt: skip
    write_run_description(asked, "here", 0.0, None)
    written = json.loads((tmp_path / "run.json").read_text())
    assert written["homes"] == [f"a.sh3d sha256:{file_sha256(plan)}"]
    assert written["preset"] == under.preset
    (spec,) = asked.specs()
    record = failed_record(spec, "no reason", "here")
    assert record.key == spec.key
    assert record.home_file == spec.home_file
    check_goes_on(asked, [record], written)
    with pytest.raises(InvalidInput, match="another preset"):
        check_goes_on(asked, [record.model_copy(update={"preset_hash": "0" * 64})], written)


def test_the_command_prints_what_it_takes_and_writes_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, picture = _small(tmp_path / "a.sh3d"), tmp_path / "a.png"
    assert cli.run(["eval", "plan", str(plan), "--out", str(picture)]) == 0
    said = capsys.readouterr().out
    assert "can carry things: 1 desk, 1 dining table" in said
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert cli.run(["eval", "plan", str(tmp_path / "none.sh3d")]) == 2
    assert "does not exist" in capsys.readouterr().err
