"""The study that gives recorded observations to the object map again."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_core.errors import InvalidInput
from helios_eval.studies import map_histories
from helios_eval.studies.map_histories import Moment, events_of, figures_of, main, record, replay
from helios_objectmap.settings import ObjectMapSettings


def moment(score: tuple[float, ...], at: tuple[str, ...]) -> Moment:
    return Moment("object", score, at)


def test_the_figures_count_ranking_best_instances_and_lost_ones() -> None:
    found = figures_of([[
        moment((0.6, 0.2), ("mug_0", "")), moment((0.1, 0.3), ("mug_0", "")), moment((), ()),
        moment((0.4,), ("",)),
    ]])["object"]  # fmt: skip
    assert found.row() == ["0.500", "0.50", "0.75", "5"]


def test_a_thing_never_believed_cannot_be_lost() -> None:
    found = figures_of([[moment((0.1,), ("mug_0",)), moment((0.0,), ("mug_0",))]])["object"]
    assert found.below_half == []
    assert found.row()[0] == "nan"


def test_another_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "helios-1.history.gz"
    path.write_bytes(map_histories.gzip.compress(b"X\x00\x00\x00\x00"))
    with pytest.raises(InvalidInput, match="is no history"):
        list(events_of(path))
    path.unlink()
    assert main(["replay", str(tmp_path)]) == 2
    assert "has no histories; `record` writes them" in capsys.readouterr().err


@pytest.mark.timeout(300)
def test_a_recorded_episode_replays_to_the_beliefs_that_it_had(tmp_path: Path) -> None:
    path = record(3, "trusting", "demo-v1", "", tmp_path, {})
    moments = replay(path, ObjectMapSettings(agent="trusting"))
    assert {m.role for m in moments} == {"object", "start", "goal"}
    assert any(any(m.at) for m in moments)
    assert moments == replay(path, ObjectMapSettings(agent="trusting"))
