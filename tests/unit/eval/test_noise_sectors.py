"""Tests the study of errors by viewing sector, and the studies of the severity of errors."""

import io
import json
import math

import numpy as np
import pytest
from eval_constructed_records import record
from helios_core.errors import InvalidInput
from helios_eval.report.interval_statistics import paired_ratio
from helios_eval.studies import noise_sectors, noise_severity, scorer_severity
from helios_eval.studies.noise_plot import alike, view_table
from helios_eval.studies.noise_severity import Factors, kept, scaled_table
from helios_eval.studies.scorer_severity import ratio_of
from rich.console import Console

SECTORS, SMOOTH = view_table("ovmm-v1"), view_table("ovmm-v1-smooth")
HERE_M = (2.5, 2.5)


def test_errors_of_ovmm_v1_are_constant_in_the_sectors_of_the_agent_only():
    assert noise_sectors.constant(SECTORS, 0.0, HERE_M) > 0.999
    assert noise_sectors.constant(SECTORS, 15.0, HERE_M) < 0.85


def test_errors_of_ovmm_v1_smooth_are_as_constant_in_any_sector():
    own, shifted = (noise_sectors.constant(SMOOTH, s, HERE_M) for s in (0.0, 15.0))
    assert abs(own - shifted) < 0.02
    assert 0.8 < own < 0.95


def test_boundaries_of_the_sectors_part_the_errors_of_ovmm_v1_but_not_of_the_smooth_table():
    assert noise_sectors.across(SECTORS, 0.0) < 0.7
    assert noise_sectors.across(SECTORS, 15.0) > 0.999
    for angle_deg in (0.0, 15.0):
        assert noise_sectors.across(SMOOTH, angle_deg) > 0.99


def test_two_frames_of_both_tables_are_as_alike_at_every_angle():
    for apart_deg in noise_sectors.ANGLES_DEG:
        old, new = (noise_sectors.by_angle(t, apart_deg) for t in (SECTORS, SMOOTH))
        assert abs(old - new) < 0.04, apart_deg


def test_the_study_prints_a_row_for_each_table(monkeypatch):
    monkeypatch.setattr(noise_sectors, "OBJECTS", 500)
    out = io.StringIO()
    noise_sectors.show([SECTORS, SMOOTH], Console(file=out, width=120))
    assert out.getvalue().count("ovmm-v1-smooth") == 2


def test_the_similarity_of_views_decreases_with_their_distance_in_the_smooth_table():
    curve = alike(SMOOTH)
    assert curve[0] > curve[1] > curve[2] > curve[3] > curve[6]


def test_the_severity_study_scales_a_table_of_a_file(tmp_path, monkeypatch):
    own = tmp_path / "own.toml"
    own.write_text('base = "ovmm-v1"\nname = "own"\n[scale]\nmiss = 0.2\n')
    monkeypatch.chdir(tmp_path)
    for said in ("own.toml", str(own)):
        path = tmp_path / "runs" / "1-1-2" / "own.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(scaled_table(said, Factors(1.0, 1.0, 2.0)))
        assert view_table(str(path)).file.scale.miss == pytest.approx(0.4)


@pytest.mark.parametrize("table", [SECTORS, SMOOTH], ids=lambda t: t.name)
def test_the_severity_study_multiplies_the_scales_of_any_table_and_nothing_else(table, tmp_path):
    path = tmp_path / "scaled.toml"
    path.write_text(scaled_table(table.name, Factors(2.0, 0.5, 3.0)))
    scale = table.file.scale
    assert view_table(str(path)).file == table.file.model_copy(
        update={
            "scale": scale.model_copy(
                update={
                    "confuse": 2 * scale.confuse,
                    "second": 2 * scale.second,
                    "false": 0.5 * scale.false,
                    "miss": pytest.approx(3 * scale.miss),
                }
            )
        }
    )


def test_the_severity_study_refuses_a_table_without_scales():
    with pytest.raises(InvalidInput, match="ovmm-v1"):
        scaled_table("demo-v1", Factors(1, 1, 1))


def test_a_kept_share_has_the_interval_of_the_report():
    truth, noisy = [True] * 12 + [False] * 4, [True] * 5 + [False] * 11
    found = kept("pick", "1:1:1", truth, noisy)
    assert found.ratio == paired_ratio(np.array(noisy, float), np.array(truth, float))
    assert found.to_json() == {
        "metric": "pick",
        "factors": "1:1:1",
        "truth": 0.75,
        "noisy": 0.3125,
        "ratio": found.ratio.value,
        "low": found.ratio.low,
        "high": found.ratio.high,
    }


@pytest.mark.parametrize(
    ("truth", "noisy"),
    [
        ([False] * 9 + [True], [False] * 8 + [True] * 2),
        ([True] * 5, [True] * 5),
        ([False] * 5, [False] * 5),
        ([False] * 8, [True] * 8),
    ],
)
def test_a_kept_share_that_cannot_be_told_has_no_bounds(truth, noisy):
    found = kept("pick", "1:1:1", truth, noisy)
    assert not math.isfinite(found.ratio.high)
    assert found.to_json()["high"] is None
    assert json.dumps(found.to_json(), allow_nan=False)
    out = io.StringIO()
    noise_severity.show([found], {"pick": 0.34}, Console(file=out, width=120))
    assert "nan" not in out.getvalue()


def spl(values: list[float]):
    """Records of object navigation with these SPL."""
    return [
        record(s, benchmark="objectnav", success=v > 0, path_m=1 / v if v else 1.0,
               shortest_path_m=1.0)
        for s, v in enumerate(values)
    ]  # fmt: skip


def test_a_ratio_of_spl_has_the_interval_of_the_report():
    random, vlfm = [0.5, 0.0] * 6, [0.25, 0.5] * 6
    found = ratio_of("0.3", spl(random), spl(vlfm))
    assert found.ratio == paired_ratio(np.array(vlfm), np.array(random))
    assert (found.homes, found.random_spl, found.vlfm_success) == (12, 0.25, 1.0)
    same = ratio_of("0.3", spl([0.5] * 5), spl([0.5] * 5))
    assert not same.ratio.has_bounds
    out = io.StringIO()
    scorer_severity.show([found, same], Console(file=out, width=120))
    assert "nan" not in out.getvalue()
    assert same.to_json()["low"] is None
