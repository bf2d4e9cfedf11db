"""Tests merging several runs into one report, and the packed form that is committed."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from helios_client import cli
from helios_core.errors import InvalidInput
from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_record import PACKED, EpisodeRecord
from helios_eval.report import paper_comparison
from helios_eval.report.agent_groups import arms_of, pairs
from helios_eval.report.report_model import Table
from helios_eval.report.requested_episodes import commands_of
from helios_eval.runs import merge_runs
from helios_eval.runs.evaluation_run import Run, write_run_description
from synthetic_episodes import NOISE, episode, write

SWEPT = {"objectmap.alpha_cs": 0.1}


def folder(path: Path, episodes: list[EpisodeRecord], command: str = "helios eval ovmm") -> Path:
    write(path, episodes, pictures=False)
    run = {"command": command.split(), "machine": "a machine", "picks": [1, "unlimited"]}
    (path / "run.json").write_text(json.dumps(run))
    return path


def paper(tmp_path: Path) -> list[Path]:
    """A folder for each table, as in docs/results/README.md, with few homes."""
    homes = range(8)
    both = ("helios-paper", "trusting")
    stops = ("vlfm", "vlfm-helios-stop", "helios-paper")
    nav = {"benchmark": "objectnav", "shortest_path_m": 3.0}
    return [
        folder(tmp_path / "noisy", [episode(s, a) for a in both for s in homes]),
        folder(tmp_path / "truth", [episode(s, a, semantics="ground-truth")
                                    for a in both for s in homes]),
        folder(tmp_path / "fifty", [episode(s, "helios-5050") for s in homes]),
        folder(tmp_path / "sweeps", [episode(s, settings=SWEPT) for s in homes]),
        folder(tmp_path / "level", [
            episode(s, a, noise=NOISE.model_copy(update={"level": 2.0}))
            for a in both for s in homes
        ]),
        folder(tmp_path / "nav", [
            episode(s, a, **nav) for a in stops for s in homes
        ], "helios eval objectnav"),
    ]  # fmt: skip


def test_several_folders_together_give_every_table_and_the_pairs(tmp_path: Path) -> None:
    folders = paper(tmp_path)
    arms = arms_of(merge_runs.episodes(folders))
    section = paper_comparison.section(arms)
    assert section is not None
    titles = [b.title for b in section.blocks if isinstance(b, Table)]
    for number in (1, 2, 4, 5, 6, 7, 8):
        assert any(title.startswith(f"Table {number}:") for title in titles), titles
    found = {f"{a.label} against {b.label}" for a, b in pairs(arms)}
    assert found >= {
        "helios-paper against trusting",
        "helios-paper · noise ×2 against trusting · noise ×2",
        "helios-paper against helios-5050",
        "helios-paper · alpha_cs=0.1 against helios-paper",
        "vlfm-helios-stop against vlfm",
        "helios-paper · ground truth against trusting · ground truth",
    }, found
    assert len(merge_runs.run(folders)["commands"]) == 6


def test_a_packed_run_is_small_and_gives_the_same_report(tmp_path: Path) -> None:
    run = folder(tmp_path / "run", [episode(s) for s in range(3)])
    small = tmp_path / "small"
    assert cli.run(["eval", "report", str(run), "--out", str(small)]) == 0
    assert (small / PACKED).stat().st_size < (run / episode_record.EPISODES).stat().st_size / 10
    assert [r.key for r in episode_record.read(small)] == [r.key for r in episode_record.read(run)]
    before = {path.name: path.read_bytes() for path in small.rglob("*.*")}
    assert cli.run(["eval", "report", str(small)]) == 0
    assert {path.name: path.read_bytes() for path in small.rglob("*.*")} == before


def test_packing_is_deterministic(tmp_path: Path) -> None:
    for name in ("one", "two"):
        merge_runs.pack(tmp_path / name, [episode(s) for s in range(3)], {})
    assert (tmp_path / "one" / PACKED).read_bytes() == (tmp_path / "two" / PACKED).read_bytes()


def test_a_folder_records_every_distinct_command_that_ran_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = Run(
        "ovmm", ("helios-paper",), ("unlimited",), "noisy", "demo-v1", 1, 0, tmp_path, 1, None, {}
    )
    for setting in ("alpha_d=0.1", "tau_g=0.3", "tau_g=0.3"):  # the last run resumes
        monkeypatch.setattr(sys, "argv", ["helios", "eval", "ovmm", "--set", setting])
        write_run_description(asked, "0" * 7, 0.0, None)
    reported = [c[-1] for c in commands_of(merge_runs.run([tmp_path]))]
    assert reported == ["alpha_d=0.1", "tau_g=0.3"]


def test_an_episode_with_different_results_in_two_folders_is_refused_by_name(
    tmp_path: Path,
) -> None:
    one = folder(tmp_path / "one", [episode(0), episode(1)])
    same = folder(tmp_path / "same", [episode(1, wall_s=9.0, commit="another")])
    assert len(merge_runs.episodes([one, same])) == 2
    other = folder(tmp_path / "other", [episode(1, steps=3)])
    with pytest.raises(InvalidInput, match=r"seed 1 of helios-paper went differently.*steps"):
        merge_runs.episodes([one, other])


def test_an_episode_goes_with_its_replay_although_its_former_record_lacks_fields(
    tmp_path: Path,
) -> None:
    new: dict[str, Any] = {"wrong_picks": 0, "shortest_path_m": 4.0, "absence": ()}
    again = folder(tmp_path / "again", [episode(0, **new)])
    nulls = folder(tmp_path / "nulls", [episode(0, wrong_picks=None, shortest_path_m=None)])
    merge_runs.pack(tmp_path / "packed", [episode(0)], {})
    for former in (nulls, tmp_path / "packed"):
        for order in ([former, again], [again, former]):
            (only,) = merge_runs.episodes(order)
            assert only.seed == 0
    new["wrong_picks"] = 1
    other = folder(tmp_path / "other", [episode(0, **new)])
    with pytest.raises(InvalidInput, match="wrong_picks"):
        merge_runs.episodes([again, other])


def test_merging_folders_needs_an_output_folder_that_holds_no_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two = (folder(tmp_path / n, [episode(k)]) for k, n in enumerate(("one", "two")))
    assert cli.run(["eval", "report", str(one), str(two)]) == 2
    assert "--out" in capsys.readouterr().err
    assert cli.run(["eval", "report", str(one), "--out", str(two)]) == 2
    assert "holds a run" in capsys.readouterr().err


def test_a_merged_folder_without_episodes_is_refused_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    played = folder(tmp_path / "a", [episode(1)])
    command = ["eval", "report", str(played), str(tmp_path / "typo"), "--out", str(tmp_path / "b")]
    assert cli.run(command) == 2
    assert "typo holds no episode" in capsys.readouterr().err
    assert not (tmp_path / "b" / "report.md").exists()


def test_a_damaged_packed_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / PACKED).write_bytes(b"\x1f\x8bnothing")
    with pytest.raises(InvalidInput, match="damaged"):
        episode_record.read(tmp_path)


def test_the_homes_without_a_task_of_all_parts_are_kept(tmp_path: Path) -> None:
    folders = [tmp_path / "one", tmp_path / "two"]
    for path, skipped, commit in zip(folders, ([3, 5], [4, 5]), ("a1", "b2"), strict=True):
        folder(path, [episode(0)])
        run = json.loads((path / "run.json").read_text())
        run |= {"without_task": {"ovmm-v1|mugs": skipped}, "why": "judge", "commit": commit}
        (path / "run.json").write_text(json.dumps(run))
    together = merge_runs.run(folders)
    assert together["without_task"] == {"ovmm-v1|mugs": [3, 4, 5]}
    assert together["why"] == "judge"
    assert "commit" not in together


def test_folders_with_another_content_of_one_name_are_refused(tmp_path: Path) -> None:
    one = folder(tmp_path / "one", [episode(0)])
    noise = NOISE.model_copy(update={"digest": "1"})
    for name, changed in (
        ("preset", episode(1, preset_hash="another")),
        ("noise", episode(1, noise=noise)),
    ):
        other = folder(tmp_path / name, [changed])
        with pytest.raises(InvalidInput, match=f"{name}.* report them apart"):
            merge_runs.episodes([one, other])


def test_folders_whose_agent_had_other_settings_are_refused(tmp_path: Path) -> None:
    folders = [folder(tmp_path / str(k), [episode(k)]) for k in range(2)]
    for path, tau_g in zip(folders, (0.5, 0.6), strict=True):
        run = json.loads((path / "run.json").read_text())
        run["ran_with"] = {"helios-paper": {"planner.tau_g": tau_g}}
        (path / "run.json").write_text(json.dumps(run))
    with pytest.raises(InvalidInput, match=r"setting helios-paper planner\.tau_g is 0\.5"):
        merge_runs.episodes(folders)


def test_an_episode_that_could_not_be_played_gives_way_to_one_that_was(tmp_path: Path) -> None:
    lost = episode(0, structure_hash="", steps=0, cause="system error", success=False)
    folders = [folder(tmp_path / "a", [lost]), folder(tmp_path / "b", [episode(0)])]
    for order in (folders, folders[::-1]):
        (only,) = merge_runs.episodes(order)
        assert only.was_played
