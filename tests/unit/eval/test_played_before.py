"""Tests that reports and `helios eval` tell how often homes from seed 1000 on had been played."""

from __future__ import annotations

import json
from collections.abc import Generator, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from eval_constructed_records import record, record_of
from helios_eval import ledger
from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_player import PlayedEpisode
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.ledger import AFTERWARDS, LEDGER, Entry
from helios_eval.provenance import checkout
from helios_eval.report import played_before, write_report
from helios_eval.report.run_description import run_of
from helios_eval.runs import evaluation_run, merge_runs
from helios_eval.runs.evaluation_run import Run, run
from helios_eval.runs.process_pool import Outcome
from rich.console import Console

SUMMER, AUTUMN, WINTER = (f"2026-{month}-01T12:00:00+00:00" for month in ("07", "10", "12"))
UNSEEN = "no longer one of unseen homes"


def line(out: str, at: str, first: int = 1200, last: int = 1209, **changes: Any) -> Entry:
    facts = {
        "at": at, "by": "me", "commit": "c", "why": "", "benchmark": "ovmm", "preset": "ovmm-v1",
        "first_seed": first, "last_seed": last, "homes": last - first + 1,
        "agents": ("helios-paper",), "out": out,
    }  # fmt: skip
    return Entry.model_validate(facts | changes)


def write_ledger(path: Path, *entries: Entry) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(e.model_dump_json() + "\n" for e in entries))


def description(out: str, since: str | None = AUTUMN, **changes: Any) -> dict[str, Any]:
    """A `run.json`; without `since`, as it was written before it named its folders."""
    order = {
        "benchmark": "ovmm",
        "agents": ["helios-paper", "trusting"],
        "semantics": "noisy",
        "preset": "ovmm-v1",
        "noise": None,
        "settings": {},
        "seed0": 1200,
        "episodes": 10,
    }
    folders = {"folders": [{"out": out, "since": since}]} if since else {}
    return {"out": out, "asked": [order], "commands": [["helios"]], **folders, **changes}


RECORDS = [record(seed) for seed in range(1200, 1210)]


def fact(described: dict[str, Any], records: Sequence[Any] = RECORDS) -> str:
    ((name, text),) = played_before.fact(records, described)
    assert name == "played before"
    return text


# --- the report -----------------------------------------------------------------------------------
def test_a_run_of_development_homes_says_nothing(own_ledger: Path) -> None:
    write_ledger(own_ledger, line("runs/a", SUMMER, 0, 2000))
    assert played_before.fact([record(999)], description("runs/b")) == []
    assert played_before.notice([record(999)], description("runs/b")) == ""
    assert played_before.sentence([record(999)], description("runs/b")) == ""


def test_a_first_run_was_never_played_before_by_the_ledger(own_ledger: Path) -> None:
    write_ledger(own_ledger, line("runs/b", AUTUMN), line("runs/a", SUMMER, 1210, 1300))
    assert fact(description("runs/b")) == "never by the ledger"
    assert played_before.notice(RECORDS, description("runs/b")) == ""
    assert "nobody had played" in played_before.sentence(RECORDS, description("runs/b"))


def test_the_fact_names_the_number_the_first_day_and_the_folders(own_ledger: Path) -> None:
    write_ledger(
        own_ledger,
        line("runs/x", AUTUMN),
        line("runs/a", SUMMER),
        line("runs/a", SUMMER),
        line("runs/b", AUTUMN),
        line("runs/c", SUMMER, preset="demo-v1"),
    )
    told = fact(description("runs/b"))
    assert told == "by 2 runs, first 2026-07-01, folders runs/a, runs/x"
    notice = played_before.notice(RECORDS, description("runs/b"))
    assert notice.startswith("All 10 homes from seed 1000 on had been played before this run, by 2")


def test_a_home_with_realistic_furniture_is_another_home(own_ledger: Path) -> None:
    own = line("runs/d", AUTUMN)
    write_ledger(own_ledger, line("runs/a", SUMMER, preset="ovmm-v1+sweethome3d"), own)
    assert fact(description("runs/d")) == "never by the ledger"


def test_a_part_of_the_homes_is_told_by_its_seeds(own_ledger: Path) -> None:
    write_ledger(own_ledger, line("runs/a", SUMMER, 1100, 1202), line("runs/b", AUTUMN))
    assert fact(description("runs/b")).endswith("folders runs/a (seeds 1200–1202)")
    assert "3 of 10 homes" in played_before.notice(RECORDS, description("runs/b"))


@pytest.mark.parametrize("since", [AUTUMN, None])
def test_a_run_that_was_continued_in_parts_counts_once(since: str | None, own_ledger: Path) -> None:
    parts = (line("runs/b", AUTUMN), line("runs/b", WINTER, 1204, 1209, agents=("trusting",)))
    write_ledger(own_ledger, *parts)
    assert fact(description("runs/b", since)) == "never by the ledger"
    other = description("runs/d", WINTER, started=WINTER)
    assert fact(other) == "by 1 run, first 2026-10-01, folders runs/b"


def test_a_folder_that_was_deleted_and_played_anew_does_not_hide_the_first_run(
    own_ledger: Path,
) -> None:
    write_ledger(own_ledger, line("runs/b", SUMMER), line("runs/b", AUTUMN))
    assert fact(description("runs/b")) == "by 1 run, first 2026-07-01, folders runs/b"


def test_homes_played_anew_by_other_code_in_the_same_folder_were_played_before(
    own_ledger: Path,
) -> None:
    """Somebody deleted the episodes of the first line, and left `run.json`."""
    write_ledger(own_ledger, line("runs/b", AUTUMN, commit="abcdef0"), line("runs/b", WINTER))
    assert fact(description("runs/b")) == "by 1 run, first 2026-10-01, folders runs/b"
    assert "not those of unseen homes" in played_before.notice(RECORDS, description("runs/b"))
    assert "1 earlier run" in played_before.sentence(RECORDS, description("runs/b"))


def test_a_part_that_other_code_played_is_a_part_if_its_episodes_are_there(
    own_ledger: Path,
) -> None:
    write_ledger(own_ledger, line("runs/b", AUTUMN, commit="abcdef0"), line("runs/b", WINTER))
    both = [*RECORDS[1:], record(1200, commit="abcdef01-dirty")]
    assert fact(description("runs/b"), both) == "never by the ledger"
    others = [*RECORDS, record(1200, commit="abcdef0", agent="trusting")]
    assert fact(description("runs/b"), others).startswith("by 1 run")


def test_a_commit_with_the_same_code_plays_a_part_of_the_run(
    own_ledger: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same code gives the same episodes, so that playing them anew shows nothing new."""
    write_ledger(own_ledger, line("runs/b", AUTUMN, commit="abcdef0"), line("runs/b", WINTER))
    monkeypatch.setattr(played_before, "same_code", lambda *_: True)
    assert fact(description("runs/b")) == "never by the ledger"


@pytest.mark.parametrize(
    "other",
    [{"benchmark": "objectnav"}, {"agents": ("helios",)}, {"first": 1199}, {"last": 1210}],
)
def test_another_request_in_the_same_folder_is_another_run(
    other: dict[str, Any], own_ledger: Path
) -> None:
    write_ledger(own_ledger, line("runs/b", SUMMER, **other), line("runs/b", AUTUMN))
    assert fact(description("runs/b", None)).startswith("by 1 run, first 2026-07-01")


def test_parts_of_one_release_are_told_apart(own_ledger: Path) -> None:
    release: dict[str, Any] = {"why": "tables", "commit": "1234567-dirty"}
    part = description("runs/b", why="tables", commit="12345678")
    first, own = line("runs/a", SUMMER, **release), line("runs/b", AUTUMN, **release)
    write_ledger(own_ledger, first, own)
    assert fact(part) == "by 1 run, first 2026-07-01, folders runs/a"
    assert played_before.notice(RECORDS, part) == (
        "All 10 homes from seed 1000 on had been played before this run, by 1 run of the same "
        "release (tables, commit 1234567): runs/a."
    )
    told = "The ledger has 1 earlier run of these homes"
    assert played_before.sentence(RECORDS, part) == f"{told}, of the same release."
    changes: list[dict[str, Any]] = [{"commit": "7654321"}, {"why": "more tables"}, {"why": ""}]
    for changed in changes:
        write_ledger(own_ledger, first, line("runs/c", SUMMER, **release | changed), own)
        assert "not those of unseen homes" in played_before.notice(RECORDS, part)
        assert "the same release" not in played_before.sentence(RECORDS, part)


def test_later_runs_are_not_before(own_ledger: Path) -> None:
    write_ledger(own_ledger, line("runs/b", AUTUMN), line("runs/c", WINTER))
    assert fact(description("runs/b")) == "never by the ledger"
    no_line = description("runs/elsewhere", None)
    assert fact(no_line | {"started": AUTUMN}).endswith("folders runs/b")


@pytest.mark.parametrize("others", [(), (line("runs/b", AUTUMN, 1200, 1208),)])
def test_a_run_that_the_ledger_lacks_is_not_called_unseen(
    others: tuple[Entry, ...], own_ledger: Path
) -> None:
    """Its homes were played where this ledger is not, all of them or one."""
    write_ledger(own_ledger, *others)
    assert fact(description("runs/b")) == "unknown: the ledger has no line of this run"
    assert "no line of this run" in played_before.notice(RECORDS, description("runs/b"))
    assert "unknown" in played_before.sentence(RECORDS, description("runs/b"))


def test_a_trial_with_other_settings_is_another_run(own_ledger: Path) -> None:
    known: dict[str, Any] = {"semantics": "noisy", "settings": {}}
    changed: dict[str, Any] = known | {"settings": {"planner.tau_g": 0.3}}
    trial = line("runs/b", SUMMER, **changed)
    own = line("runs/b", AUTUMN, **known)
    write_ledger(own_ledger, trial, own)
    assert fact(description("runs/b", SUMMER)) == "by 1 run, first 2026-07-01, folders runs/b"
    write_ledger(own_ledger, trial.model_copy(update=known), own)
    assert fact(description("runs/b", SUMMER)) == "never by the ledger"


def test_a_copy_in_another_folder_keeps_its_own_lines(tmp_path: Path, own_ledger: Path) -> None:
    folders = []
    for name in ("b", "c"):
        folder = tmp_path / name
        merge_runs.pack(folder, RECORDS, description(f"runs/{name}"))
        folders.append(folder)
    write_ledger(own_ledger, line("runs/b", AUTUMN), line("runs/c", AUTUMN))
    assert fact(merge_runs.run(folders)) == "never by the ledger"
    assert fact(merge_runs.run(folders[:1])).endswith("folders runs/c")
    write_ledger(own_ledger, *ledger.read(own_ledger), line("runs/a", SUMMER))
    assert fact(merge_runs.run(folders)) == "by 1 run, first 2026-07-01, folders runs/a"


def test_an_older_run_json_gives_the_folders_of_its_commands() -> None:
    commands = [["helios", "--out", "runs/a/"], ["helios", "--out=runs/b"], "helios", ["--out"]]
    found = played_before.folders_of({"commands": commands, "out": "runs/a"})
    assert [(f.out, f.since) for f in found] == [("runs/a", None), ("runs/b", None)]


def test_an_unreadable_ledger_does_not_stop_the_report(
    tmp_path: Path, own_ledger: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_ledger(own_ledger, line("runs/a", SUMMER))
    for damage in (b"\xff\n", b"{}\n"):
        own_ledger.write_bytes(damage)
        assert "line 1 is no entry" in fact(description("runs/b"))
    own_ledger.unlink()
    own_ledger.mkdir()
    assert "cannot be read" in fact(description("runs/b"))
    merge_runs.pack(tmp_path / "run", RECORDS, description("runs/b"))
    write_report(tmp_path / "run")
    monkeypatch.setattr(ledger, "ledger_path", lambda: None)
    assert fact(description("runs/b")).startswith("unknown: an installation")


def test_both_reports_show_the_fact_and_begin_with_the_notice(
    tmp_path: Path, own_ledger: Path
) -> None:
    write_ledger(own_ledger, line("runs/a", SUMMER), line("runs/b", AUTUMN))
    merge_runs.pack(tmp_path, RECORDS, description("runs/b"))
    write_report(tmp_path)
    for name in ("report.md", "report.html"):
        text = (tmp_path / name).read_text()
        assert "by 1 run, first 2026-07-01, folders runs/a" in text
        assert text.index("not those of unseen homes") < text.index("simulator of this project")
    lines = (tmp_path / "report.md").read_text().splitlines()
    assert next(k for k, one in enumerate(lines) if one.startswith("> All 10 homes")) < 8


# --- the committed files --------------------------------------------------------------------------
def committed() -> Path:
    root = checkout()
    assert root is not None
    return root


def test_the_ledger_begins_with_the_four_plays_of_the_validation_homes() -> None:
    first = ledger.read(committed() / LEDGER)[:4]
    assert [e.commit for e in first] == ["bcb995c", "f1d4da1", "cfe2387", "dc49a59"]
    for entry, success in zip(first, ("26.5", "32.0", "33.0", "34.5"), strict=True):
        assert (entry.first_seed, entry.last_seed, entry.by) == (1000, 1199, AFTERWARDS)
        assert f"{success} %" in entry.why
        assert AFTERWARDS in entry.why


@pytest.mark.parametrize("name", ["noisy", "ground-truth", "objectnav"])
def test_the_committed_runs_of_the_validation_homes_had_three_before_them(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fourth line is of their own commit."""
    monkeypatch.setattr(ledger, "ledger_path", lambda: committed() / LEDGER)
    folder = committed() / "docs/results" / name
    records = episode_record.read(folder)
    told = fact(run_of(folder), records)
    assert told.startswith("by 3 runs, first 2026-11-21, folders /tmp/results/noisy, ")
    assert "before this run, by 3 runs" in played_before.notice(records, run_of(folder))


@pytest.mark.parametrize(
    "folder", sorted(p.parent.name for p in (committed() / "docs/results").glob("*/run.json"))
)
def test_the_ledger_has_every_committed_run_of_homes_from_seed_1000_on(
    folder: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ledger, "ledger_path", lambda: committed() / LEDGER)
    records = episode_record.read(committed() / "docs/results" / folder)
    assert not played_before.lacks_line(records, run_of(committed() / "docs/results" / folder))


# --- the terminal ---------------------------------------------------------------------------------
@pytest.fixture
def fake_pool(monkeypatch: pytest.MonkeyPatch) -> None:
    def outcomes(_: Run, missing: Sequence[EpisodeSpec], __: str) -> Generator[Outcome]:
        for spec in missing:
            yield spec, PlayedEpisode(record_of(spec))

    monkeypatch.setattr(evaluation_run, "_outcomes", outcomes)


def printed(out: Path, seed0: int, episodes: int) -> list[str]:
    """Lines about the ledger that a run prints; it plays all of its episodes."""
    console = Console(file=StringIO(), width=80)
    asked = Run(
        "ovmm", ("trusting",), (1,), "ground-truth", "ovmm-v1", episodes, seed0, out, 1, None, {}
    )
    assert len(run(asked, console)) == episodes
    assert isinstance(console.file, StringIO)
    return [one for one in console.file.getvalue().splitlines() if "unseen" in one]


@pytest.mark.usefixtures("fake_pool")
def test_a_run_prints_one_line_if_the_ledger_names_its_homes(
    tmp_path: Path, own_ledger: Path
) -> None:
    write_ledger(own_ledger, line("runs/a", SUMMER, 1200, 1201), line("runs/b", AUTUMN, 1200, 1201))
    assert printed(tmp_path / "below", 0, 2) == []
    assert printed(tmp_path / "fresh", 1202, 2) == []
    (told,) = printed(tmp_path / "run", 1200, 3)
    assert told.startswith("All 3 homes from seed 1000 on (seeds 1200–1202) have been played")
    assert "by 3 runs since 2026-07-01" in told
    assert UNSEEN in told


@pytest.mark.usefixtures("fake_pool")
def test_a_run_that_continues_its_folder_prints_nothing(tmp_path: Path, own_ledger: Path) -> None:
    assert printed(tmp_path / "run", 1200, 2) == []
    assert printed(tmp_path / "run", 1200, 4) == []
    assert len(ledger.read(own_ledger)) == 2
    (told,) = printed(tmp_path / "other", 1203, 2)
    assert told.startswith("1 of 2 homes from seed 1000 on (seeds 1203) have been played")
    assert "by 1 run since" in told


@pytest.mark.usefixtures("fake_pool", "own_ledger")
def test_a_run_of_other_code_into_a_folder_without_its_episodes_prints_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "run"
    assert printed(out, 1200, 2) == []
    (out / episode_record.EPISODES).unlink()
    assert printed(out, 1200, 2) == []
    (out / episode_record.EPISODES).unlink()
    monkeypatch.setattr(evaluation_run, "commit", lambda: "fffffff")
    (told,) = printed(out, 1200, 2)
    assert told.startswith("All 2 homes from seed 1000 on (seeds 1200–1201) have been played")


@pytest.mark.usefixtures("fake_pool")
def test_run_json_keeps_the_first_start_of_each_folder(tmp_path: Path, own_ledger: Path) -> None:
    out = tmp_path / "run"
    printed(out, 1200, 1)
    ((name, since),) = [(f.out, f.since) for f in played_before.folders_of(run_of(out))]
    assert name == str(out)
    assert since is not None
    assert since <= ledger.read(own_ledger)[0].at
    earlier = run_of(out) | {"folders": [{"out": str(out), "since": SUMMER}]}
    (out / "run.json").write_text(json.dumps(earlier))
    printed(out, 1200, 2)
    assert run_of(out)["folders"] == [{"out": str(out), "since": SUMMER}]


@pytest.mark.usefixtures("fake_pool")
def test_a_damaged_ledger_stops_no_run(tmp_path: Path, own_ledger: Path) -> None:
    own_ledger.parent.mkdir(parents=True)
    own_ledger.write_text("damaged\n")
    assert printed(tmp_path / "run", 1200, 1) == []
