"""The ledger records every home from seed 1000 on before it is played."""

from __future__ import annotations

import argparse
import re
import subprocess
from pathlib import Path

import pytest
from helios_core.errors import InvalidInput, Unavailable
from helios_eval import ledger, provenance
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.provenance import LEDGER, checkout
from helios_eval.runs import evaluation_run
from helios_eval.runs.evaluation_run import Run, run
from helios_eval.runs.process_pool import Outcome
from helios_eval.studies import development_homes
from helios_eval.video import episode_recorder
from helios_eval.video.video_command import video
from rich.console import Console


def specs(*seeds: int, agent: str = "trusting") -> list[EpisodeSpec]:
    return [EpisodeSpec("ovmm", agent, "noisy", "ovmm-v1", seed, None, {}) for seed in seeds]


def test_the_ledger_is_in_the_checkout() -> None:
    root = checkout()
    assert root is not None
    assert (root / "pyproject.toml").exists()


def test_without_git_the_commit_is_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert provenance.commit() == "unknown"


def test_a_line_in_the_ledger_leaves_the_commit_clean_and_another_change_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "checkout"
    code = root / "clients" / "helios_eval" / "provenance.py"
    book = root / LEDGER
    for file in (code, book):
        file.parent.mkdir(parents=True)
        file.write_text("first\n")
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    for words in (("init", "-q"), ("add", "-A"), (*who, "commit", "-qm", "first")):
        subprocess.run(["git", "-C", str(root), *words], check=True)
    monkeypatch.setattr(provenance, "__file__", str(code))
    clean = provenance.commit()
    assert re.fullmatch("[0-9a-f]{8}", clean)
    book.write_text("first\nsecond\n")
    (root / "untracked").touch()
    assert provenance.commit() == clean
    new = code.with_name("untracked.py")
    new.touch()
    assert provenance.commit() == f"{clean}-dirty"
    new.unlink()
    code.write_text("other\n")
    assert provenance.commit() == f"{clean}-dirty"
    subprocess.run(["git", "-C", str(root), *who, "commit", "-qm", "second", str(book)], check=True)
    code.write_text("first\n")
    of_the_ledger = provenance.commit()
    assert of_the_ledger != clean
    assert provenance.same_code(clean, of_the_ledger)
    code.write_text("other\n")
    subprocess.run(["git", "-C", str(root), *who, "commit", "-qm", "third", str(code)], check=True)
    assert not provenance.same_code(clean, provenance.commit())
    assert not provenance.same_code("12345678", clean)


def test_development_homes_are_not_recorded(own_ledger: Path) -> None:
    assert ledger.enter(specs(0, 999), Path("runs/a"), "abc", "") is None
    assert not own_ledger.exists()


def test_an_entry_has_the_homes_the_agents_the_commit_and_the_reason(own_ledger: Path) -> None:
    asked = [*specs(999, 1000, 1004), *specs(1000, agent="helios")]
    ledger.enter(asked, Path("runs/a"), "abc", "a look at totals")
    (entry,) = ledger.read(own_ledger)
    assert (entry.first_seed, entry.last_seed, entry.homes) == (1000, 1004, 2)
    assert entry.agents == ("trusting", "helios")
    assert (entry.commit, entry.why, entry.out) == ("abc", "a look at totals", "runs/a")
    assert entry.at.endswith("+00:00")
    assert (entry.semantics, entry.noise, entry.settings) == ("noisy", None, {})


def test_lines_are_appended_in_order(own_ledger: Path) -> None:
    for out, seeds in (("runs/a", (1000, 1003)), ("runs/b", (1002, 1009)), ("runs/a", (1000,))):
        ledger.enter(specs(*seeds), Path(out), "abc", "")
    assert [e.out for e in ledger.read(own_ledger)] == ["runs/a", "runs/b", "runs/a"]


def test_a_run_that_is_stopped_at_its_first_home_stands_in_the_ledger(
    tmp_path: Path, own_ledger: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object) -> Outcome:
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluation_run, "play_all", stopped)
    asked = Run(
        "ovmm", ("trusting",), (1,), "ground-truth", "ovmm-v1", 3, 1200, tmp_path / "run", 1, None,
        {}, why="publication",
    )  # fmt: skip
    with pytest.raises(KeyboardInterrupt):
        run(asked, Console(quiet=True))
    (entry,) = ledger.read(own_ledger)
    assert (entry.first_seed, entry.last_seed, entry.why) == (1200, 1202, "publication")


def test_no_home_is_played_if_the_ledger_cannot_be_written(
    tmp_path: Path, own_ledger: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own_ledger.mkdir(parents=True)  # a folder in the place of the file
    played: list[object] = []
    monkeypatch.setattr(evaluation_run, "play_all", lambda *_: played.append(1))
    asked = Run(
        "ovmm", ("trusting",), (1,), "ground-truth", "ovmm-v1", 1, 1200, tmp_path / "run", 1, None,
        {},
    )  # fmt: skip
    with pytest.raises(Unavailable, match="are not played without it"):
        run(asked, Console(quiet=True))
    assert not played


@pytest.mark.parametrize("line", ["no JSON", "{}", "[]", '{"at": 3}'])
def test_a_damaged_line_is_reported_with_its_number(own_ledger: Path, line: str) -> None:
    ledger.enter(specs(1000), Path("runs/a"), "abc", "")
    with own_ledger.open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InvalidInput, match="line 2 is no entry"):
        ledger.read(own_ledger)


def test_an_installed_package_has_no_ledger(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ledger, "ledger_path", lambda: None)
    assert ledger.enter(specs(1000), Path("runs/a"), "abc", "") is None


def test_a_video_of_such_a_home_stands_in_the_ledger(
    tmp_path: Path, own_ledger: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(episode_recorder, "film", lambda *_: "filmed")
    for seed in (999, 1000):
        video(seed=seed, out=tmp_path / "film.mp4", agent="helios-paper")
    (entry,) = ledger.read(own_ledger)
    assert (entry.first_seed, entry.agents, entry.why) == (1000, ("helios-paper",), "video")


def test_a_study_plays_development_homes_alone() -> None:
    assert list(development_homes.homes(998, 2)) == [998, 999]
    assert development_homes.seeds("3,998-999") == (3, 998, 999)
    with pytest.raises(InvalidInput, match=r"homes 998 to 1000.*enters them in the ledger"):
        development_homes.homes(998, 3)
    with pytest.raises(argparse.ArgumentTypeError, match="0 to 999"):
        development_homes.seeds("5,999-1000")


def test_each_study_that_asks_for_homes_checks_them() -> None:
    folder = Path(development_homes.__file__).parent
    asking = [f for f in folder.rglob("*.py") if re.search(r'"--seeds?0?"', f.read_text())]
    assert len(asking) >= 10
    for file in asking:
        text = file.read_text()
        imported = re.search(r"helios_eval\.studies\.development_homes import (.+)", text)
        assert imported, file
        for name in imported[1].split(", "):
            assert re.search(rf"\b{name}\(|type={name}\b", text), f"{file} does not use {name}"
