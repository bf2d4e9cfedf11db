"""Tests reading episode records, also after an interrupted write."""

from __future__ import annotations

from pathlib import Path

import pytest
from eval_constructed_records import belief, record
from helios_client import cli
from helios_core.errors import InvalidInput, Unavailable
from helios_eval.episodes import episode_record as records
from helios_eval.report.run_description import run_of
from hypothesis import given
from hypothesis import strategies as st

FIRST, SECOND, THIRD = record(1, (belief(3, True),)), record(2), record(3)


def test_read_records_equal_the_written_ones(tmp_path: Path) -> None:
    assert records.read(tmp_path) == []
    for one in (FIRST, SECOND):
        records.append(tmp_path, one)
    assert records.read(tmp_path) == [FIRST, SECOND]


@given(cut=st.integers(1, len(SECOND.model_dump_json())))
def test_a_torn_last_line_loses_only_its_record(
    cut: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("torn")
    records.append(folder, FIRST)
    with (folder / records.EPISODES).open("a") as file:
        file.write(SECOND.model_dump_json()[:cut])
    whole = cut == len(SECOND.model_dump_json())
    assert records.read(folder) == ([FIRST, SECOND] if whole else [FIRST])
    records.append(folder, THIRD)
    assert records.read(folder) == ([FIRST, SECOND, THIRD] if whole else [FIRST, THIRD])
    records.append(folder, SECOND)
    assert {r.seed for r in records.read(folder)} == {1, 2, 3}


@pytest.mark.parametrize("name", [records.EPISODES, records.PACKED])
def test_a_file_that_cannot_be_read_is_named_as_such(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(Unavailable, match=f"{name} cannot be read .*; make it a readable file"):
        records.read(tmp_path)
    for command in (["report"], ["calibration", "--out", str(tmp_path / "out")]):
        assert cli.run(["eval", *command, str(tmp_path)]) == 1
        said = capsys.readouterr().err
        assert f"{name} cannot be read" in said
        assert "cannot write" not in said


def test_a_description_that_cannot_be_read_is_named_as_such(tmp_path: Path) -> None:
    assert run_of(tmp_path) == {}
    (tmp_path / "run.json").mkdir()
    with pytest.raises(Unavailable, match=r"run\.json cannot be read"):
        run_of(tmp_path)


def test_the_last_record_of_a_key_counts(tmp_path: Path) -> None:
    records.append(tmp_path, FIRST)
    records.append(tmp_path, FIRST.model_copy(update={"steps": 7}))
    assert [r.steps for r in records.read(tmp_path)] == [7]


@pytest.mark.parametrize("line", ["hello", '{"a": 1}', '{"benchmark": 3}', "[]"])
def test_an_invalid_line_is_refused_with_its_number(tmp_path: Path, line: str) -> None:
    records.append(tmp_path, FIRST)
    with (tmp_path / records.EPISODES).open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InvalidInput, match="line 2"):
        records.read(tmp_path)


def test_the_key_changes_with_every_condition_of_the_result() -> None:
    others = [
        record(2),
        record(1, agent="trusting"),
        record(1, semantics="ground-truth", noise=None),
        record(1, preset="demo-v1"),
        record(1, settings={"planner.alpha_d": 0.01}),
        record(1, noise={"table": "t", "digest": "1", "level": 1.0, "correlation": None}),
        record(1, benchmark="objectnav"),
    ]
    assert len({FIRST.key, *(o.key for o in others)}) == 1 + len(others)
    assert record(1, steps=3, commit="other", wall_s=9.0).key == FIRST.key
    assert record(1, settings={"a": 1, "b": 2}).key == record(1, settings={"b": 2, "a": 1}).key
