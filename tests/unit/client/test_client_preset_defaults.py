"""`helios up` gives the services the noise and the step budget of the simulated home's preset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from helios_client import cli
from helios_client.supervision.preset_defaults import PresetDefaults, preset_defaults
from helios_client.supervision.service_specs import StackOptions
from helios_detector.settings import Settings as DetectorSettings
from helios_eval.episodes import home_presets
from helios_planner.settings import Settings as PlannerSettings
from helios_sim.home import PRESETS

from tests.support import free_port

LARGE = "ovmm-large-v1"


def stack_of(monkeypatch: pytest.MonkeyPatch, folder: Path, *flags: str) -> StackOptions:
    """Options of the stack that `helios up` would start."""
    asked: list[StackOptions] = []

    def run_up(stack: StackOptions, *_: Any) -> None:
        asked.append(stack)

    monkeypatch.setattr("helios_client.supervision.up.up", run_up)
    port = ["--port", str(free_port()), "--state", str(folder / "state")]
    assert cli.run(["up", *flags, *port]) == 0
    return asked[0]


def loaded(stack: StackOptions) -> tuple[str, int]:
    """Noise table of the detector and step budget of the planner, as the services read them."""
    flags = {spec.name: list(spec.argv[3:]) for spec in stack.processes()}
    noise = DetectorSettings.load(flags["detector"]).noise
    return noise, PlannerSettings.load(flags["planner"]).max_steps


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_the_stack_has_the_noise_and_the_steps_of_the_evaluation(
    preset: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    stack = stack_of(monkeypatch, tmp_path, "--preset", preset)
    assert loaded(stack) == (
        home_presets.noise_of(preset),
        home_presets.default_steps(preset, "ovmm"),
    )


def test_large_homes_have_twice_the_steps(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    stack = stack_of(monkeypatch, tmp_path, "--robot", "sim", "--preset", "OVMM-large-v1")
    assert loaded(stack) == ("ovmm-v1", 2500)


def test_variables_and_the_settings_file_come_before_the_preset(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text("[planner]\nmax_steps = 70\n")
    monkeypatch.setenv("HELIOS_CONFIG", str(file))
    monkeypatch.setenv("HELIOS_DETECTOR_NOISE", "ovmm-v1-smooth")
    stack = stack_of(monkeypatch, tmp_path, "--preset", LARGE)
    assert loaded(stack) == ("ovmm-v1-smooth", 70)


@pytest.mark.parametrize(
    ("robot", "preset", "detector", "noise", "max_steps"),
    [
        ("sim", "demo-v1", "simulated", None, None),
        ("spot", LARGE, "simulated", None, None),
        ("sim", LARGE, "ground-truth", None, 2500),
        ("sim", LARGE, "onnx:nano.onnx", None, 2500),
    ],
)
def test_a_stack_without_such_a_home_or_simulated_errors_keeps_the_settings(
    robot: str, preset: str, detector: str, noise: str | None, max_steps: int | None
) -> None:
    assert preset_defaults(robot, preset, detector, {}) == PresetDefaults(noise, max_steps)
