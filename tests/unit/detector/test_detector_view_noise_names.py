"""Wrong names of the simulated detector: their persistence, scores and rates by class."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.ground_truth_detector import Visible
from helios_detector.simulation.view_noise import key_of
from helios_detector.simulation.view_noise_detector import SimulatedResult, joined, verdicts
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from helios_detector.simulator_truth import TruthInstance

MUGS = 60
SIDES = 12
EVERY_NAME_WRONG = (
    "[scale]\nconfuse = 100\nsecond = 100\nmiss = 0\nfalse = 0\n[confusion]\nmost = 1\n"
)


def table(folder: Path, text: str = "") -> ViewNoiseTable:
    """`ovmm-v1-smooth` with every mug reported under a wrong and its right name."""
    path = folder / "names.toml"
    path.write_text(f'base = "ovmm-v1-smooth"\nname = "names"\n{EVERY_NAME_WRONG}{text}')
    loaded = load_noise(str(path))
    assert isinstance(loaded, ViewNoiseTable)
    return loaded


def around(noise: ViewNoiseTable) -> list[list[SimulatedResult]]:
    """Results for mugs at the origin, seen from each side."""
    mugs = [
        Visible(
            TruthInstance(k, "mug", np.zeros(3), True, f"mug_{k}"),
            2000,
            (0, 0, 50, 50),
            np.ones((50, 50), bool),
        )
        for k in range(MUGS)
    ]
    keys = [key_of(mug.instance.name) for mug in mugs]
    angles = [k * math.tau / SIDES for k in range(SIDES)]
    return [
        verdicts(mugs, noise, keys, np.array([math.cos(a), math.sin(a), 0.5]), n)
        for n, a in enumerate(angles)
    ]


def wrong_names(noise: ViewNoiseTable) -> np.ndarray:
    """First reported name [sides, mugs]; always a wrong one."""
    return np.array([[r.names[0][0] for r in results] for results in around(noise)])


def test_a_wrong_name_that_belongs_to_the_object_is_the_same_from_every_side(
    tmp_path: Path,
) -> None:
    of_thing = "[persistence.name]\nthing = 1\nside = 0\nview = 0\nframe = 0\n"
    names = wrong_names(table(tmp_path, of_thing))
    assert (names == names[0]).all()
    assert len(set(names[0])) > 1
    assert "mug" not in set(names.ravel())


def test_without_shares_of_its_own_the_wrong_name_changes_with_the_side(tmp_path: Path) -> None:
    names = wrong_names(table(tmp_path))
    assert 0.2 < (names[SIDES // 2] == names[0]).mean() < 0.9


@pytest.mark.parametrize("together", [-0.8, 0.0, 0.8])
def test_scores_of_one_view_depend_on_one_another_as_the_table_says(
    tmp_path: Path, together: float
) -> None:
    noise = table(tmp_path, f"[score]\ntogether = {together}\n")
    scores = np.array(
        [[score for _, score in r.names] for results in around(noise) for r in results]
    )
    found = np.corrcoef(scores.T)[0, 1]
    assert found == pytest.approx(together, abs=0.2)


def test_joined_numbers_keep_their_variance() -> None:
    z, other = np.random.default_rng(1).normal(size=(2, 20_000))
    made = joined(z, other, -0.6)
    assert made.std() == pytest.approx(1, abs=0.03)
    assert np.corrcoef(made, other)[0, 1] == pytest.approx(-0.6, abs=0.03)


def test_a_class_may_have_a_rate_of_wrong_names_of_its_own(tmp_path: Path) -> None:
    base = load_noise("ovmm-v1-smooth")
    assert isinstance(base, ViewNoiseTable)
    path = tmp_path / "rare.toml"
    path.write_text(
        'base = "ovmm-v1-smooth"\nname = "rare"\n'
        "[scale]\nconfuse = 1\n[confusion.factor]\nmug = 0.5\n"
    )
    rare = load_noise(str(path))
    assert isinstance(rare, ViewNoiseTable)
    assert rare.confuse("mug") == pytest.approx(0.5 * rare.rows["mug"].total)
    assert rare.confuse("glass") == pytest.approx(rare.rows["glass"].total)
    assert rare.second("mug") == pytest.approx(0.5 * base.second("mug"))
