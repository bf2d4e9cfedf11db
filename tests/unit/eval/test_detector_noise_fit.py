"""Tests the noise table that is fitted to a measured detector."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from helios_eval.studies.detector_errors.error_summary import summary
from helios_eval.studies.detector_errors.noise_fit import main
from helios_eval.studies.detector_errors.sightings import FalseAlarms, Sightings

N, VIEWS = 40, 48


def run_of(folder: Path, like: str = "simulated:ovmm-v1-smooth") -> Path:
    """Run of a detector that misses small objects more often, and names a mug wrongly at times."""
    rng = np.random.default_rng(2)
    n = N * VIEWS
    pixels = np.exp(rng.uniform(np.log(60), np.log(60_000), n))
    reported = rng.uniform(size=n) < np.interp(np.log(pixels), np.log([60, 60_000]), [0.05, 0.95])
    wrong = reported & (rng.uniform(size=n) < 0.2)
    thing = np.repeat(np.arange(N), VIEWS)
    seen = Sightings(
        home=thing % 8,
        thing=thing,
        view=np.arange(n) // 2,
        class_name=np.array(["mug", "bowl"])[thing % 2],
        pixels=pixels,
        distance_m=rng.choice([1.0, 1.6], n),
        angle_rad=rng.uniform(0, 6.28, n),
        unobstructed=np.ones(n, bool),
        right=reported * rng.uniform(0.1, 0.9, n),
        wrong=wrong * rng.uniform(0.1, 0.5, n),
        wrong_name=np.where(wrong, "vase", ""),
        wrong_names=wrong.astype(np.int64),
    )
    alarms = FalseAlarms(
        100, 5, np.full(10, 0.5), np.array(["vase"] * 10), np.full(10, 900.0), np.full(10, 2.0)
    )
    figures = asdict(summary(seen, alarms))
    figures["same_wrong_name"] = dict.fromkeys(figures["same_wrong_name"], 0.9)
    text = json.dumps({"detectors": {"real.onnx": figures, like: figures}})
    (folder / "detector-errors.json").write_text(text)
    np.savez(folder / "sightings-0.npz", detector="onnx:real.onnx", **vars(seen))
    return folder


def test_the_fitted_table_loads_and_has_the_measured_errors(tmp_path: Path) -> None:
    out = tmp_path / "own.toml"
    flags = ["--severity", "2", "--false-severity", "3", "--name", "own", "--out", str(out)]
    assert main([str(run_of(tmp_path)), *flags]) == 0
    table = load_noise(str(out))
    assert isinstance(table, ViewNoiseTable)
    assert table.name == "own"
    small, large = table.miss(["mug", "mug"], np.array([80, 30_000]), np.array([2.0, 2.0]))
    assert small == pytest.approx(0.9, abs=0.1)
    assert large == pytest.approx(0.15, abs=0.1)
    assert table.name_shares.thing == pytest.approx(0.9, abs=0.06)
    base = load_noise("ovmm-v1-smooth")
    assert isinstance(base, ViewNoiseTable)
    assert table.file.scale.false == pytest.approx(3 * base.file.scale.false, rel=0.01)


def test_a_run_without_the_table_to_compare_with_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = run_of(tmp_path, like="simulated:other")
    assert main([str(run), "--out", str(tmp_path / "own.toml")]) == 2
    assert "--detector simulated:ovmm-v1-smooth" in capsys.readouterr().err
    assert not (tmp_path / "own.toml").exists()
