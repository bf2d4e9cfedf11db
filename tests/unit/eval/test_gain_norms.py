"""The orders in which each gain_norm prefers one table by the distance of its first view."""

from __future__ import annotations

import pytest
from helios_eval.studies.gain_norms import FirstView, first_views, main
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.settings import GainNorm


@pytest.fixture(scope="module")
def seen() -> list[FirstView]:
    return first_views(ObjectMapSettings())


@pytest.mark.parametrize("norm", ["sum", "per_area", "per_pixel"])
def test_sum_area_and_pixels_prefer_the_table_that_was_first_seen_from_near(
    seen: list[FirstView], norm: GainNorm
) -> None:
    worth = [v.worth(norm) for v in seen if v.thing == "table"]
    assert worth == sorted(worth, reverse=True)
    assert worth[0] > 10 * worth[-1]


def test_per_gaussian_prefers_the_table_that_was_first_seen_from_afar(
    seen: list[FirstView],
) -> None:
    worth = [v.worth("per_gaussian") for v in seen if v.thing == "table"]
    assert worth == sorted(worth)
    assert worth[-1] > 2 * worth[0]


def test_a_speck_beats_a_near_table_per_gaussian_alone(seen: list[FirstView]) -> None:
    table, speck = seen[0], seen[-1]
    assert speck.worth("per_gaussian") > table.worth("per_gaussian")
    for norm in ("sum", "per_area", "per_pixel"):
        assert speck.worth(norm) < table.worth(norm) / 10


def test_the_seen_area_does_not_depend_on_the_distance_of_the_first_view(
    seen: list[FirstView],
) -> None:
    """The number of Gaussians falls a hundredfold. At 6.5 m the view is so flat that rows of the
    surface have no Gaussian."""
    table = [v.gain for v in seen if v.thing == "table"]
    assert table[0].gaussians > 100 * table[-1].gaussians
    assert len({g.area_m2 for g in table[:-1]}) == 1
    assert table[0].area_m2 / 2 < table[-1].area_m2 <= table[0].area_m2
    assert seen[-1].gain.area_m2 < table[-1].area_m2 / 5


def test_the_expected_pixels_follow_the_size_of_a_thing(seen: list[FirstView]) -> None:
    table = [v.gain.pixels for v in seen if v.thing == "table"]
    assert max(table) < 2 * min(table)
    assert seen[-1].gain.pixels < min(table) / 5


def test_the_study_prints_one_line_for_every_norm(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    said = capsys.readouterr().out
    assert [line.split(" |")[0] for line in said.splitlines() if "S·IG" in line] == [
        "| S·IG, sum",
        "| S·IG, per_area",
        "| S·IG, per_pixel",
        "| S·IG, per_gaussian",
    ]
