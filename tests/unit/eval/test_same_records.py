"""Episodes that are played again are compared with their published records."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_core.errors import InvalidInput
from helios_eval.episodes.episode_record import append
from helios_eval.studies.same_records import compare, main
from synthetic_episodes import episode


def test_times_may_differ_and_outcomes_may_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    published = [episode(seed) for seed in range(3)]
    again = [r.model_copy(update={"wall_s": 99.0, "commit": "other"}) for r in published]
    assert (
        compare(published, again).sentence == "3 of 3 episodes are equal in every published field"
    )
    again[1] = again[1].model_copy(update={"steps": 12_345, "message": "another"})
    found = compare(published, again)
    assert found.differing == {again[1].key: ["message", "steps"]}
    for name, records in (("old", published), ("new", again)):
        (tmp_path / name).mkdir()
        for record in records:
            append(tmp_path / name, record)
    assert main([str(tmp_path / "old"), str(tmp_path / "new")]) == 1
    assert "2 of 3 episodes are equal" in capsys.readouterr().out


def test_fields_that_the_published_record_lacks_are_not_compared() -> None:
    old = episode(0)
    lacking = old.model_validate(old.model_dump(exclude={"find_object_steps"}))
    assert not compare([lacking], [old.model_copy(update={"find_object_steps": 7})]).differing


def test_runs_of_other_homes_are_refused() -> None:
    with pytest.raises(InvalidInput, match="play the published seeds"):
        compare([episode(0)], [episode(1)])
