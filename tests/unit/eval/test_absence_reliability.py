"""The study of "it is not here": reliability, and claims by threshold."""

from __future__ import annotations

from pathlib import Path

import pytest
from eval_constructed_records import record
from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_record import AbsenceEstimate
from helios_eval.studies.absence_reliability import claims, first_estimates, main, reliability


def estimate(probability: float, searches: int = 1, step: int = 100) -> AbsenceEstimate:
    return AbsenceEstimate(
        step=step,
        searches=searches,
        probability=probability,
        start_score=0.9,
        tried=0,
        best_score=0.0,
    )


PRESENT = [record(s, absence=(estimate(0.65 if s < 2 else 0.25),)) for s in range(8)]
ABSENT = [record(s, absent=True, absence=(estimate(0.65),)) for s in range(10, 14)]


def test_shares_are_weighted_as_if_few_objects_were_absent() -> None:
    found = {round(b.low, 1): b for b in reliability(PRESENT + ABSENT, 0.2)}
    high, low = found[0.6], found[0.2]
    assert (high.present, high.absent) == (2, 4)
    assert high.absent_share == pytest.approx(0.2 / (0.2 + 0.8 * 2 / 8))
    assert high.mean == pytest.approx(0.65)
    assert (low.present, low.absent, low.absent_share) == (6, 0, 0.0)


def test_a_sure_estimate_counts_and_bins_without_estimates_are_left_out() -> None:
    [only] = reliability([record(0, absent=True, absence=(estimate(1.0),))], 0.2)
    assert (only.low, only.high, only.absent, only.mean) == (0.7, 1.0, 1, 1.0)


def test_a_threshold_ends_every_search_whose_estimate_reaches_it() -> None:
    found = claims(PRESENT + ABSENT, 0.5)
    assert (found.present.value, found.absent.value) == (0.25, 1.0)
    assert claims(PRESENT + ABSENT, 0.7).absent.value == 0.0


def test_repeated_estimates_of_one_search_count_once() -> None:
    one = record(0, absence=(estimate(0.1), estimate(0.2, step=200), estimate(0.4, searches=2)))
    assert [e.probability for e in first_estimates(one)] == [0.1, 0.4]


def test_the_study_writes_its_tables_and_its_chart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    silent = [record(s, agent="trusting", absent=s > 9) for s in range(14)]
    for one in PRESENT + ABSENT + silent:
        episode_record.append(run, one)
    assert main([str(run), "--out", str(tmp_path / "out")]) == 0
    assert "| 0.5 | 25.0 % (7.1 to 59.1) | 100.0 % (51.0 to 100.0) |" in capsys.readouterr().out
    names = {"absence.md", "absence.json", "absence.png"}
    assert {p.name for p in (tmp_path / "out").iterdir()} == names


def test_a_run_without_absent_objects_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    episode_record.append(run, PRESENT[0])
    assert main([str(run), "--out", str(tmp_path / "out")]) == 2
    assert "1 episodes came, 0 with an absent object" in capsys.readouterr().err
