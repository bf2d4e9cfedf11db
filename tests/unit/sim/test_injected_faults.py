"""Injected faults of the simulated robot, and the checks that find them by size and by name."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.robot import Turn
from helios_core.robot_checks.direct_run import check_driver
from helios_core.robot_checks.finding import Finding
from helios_sim.home import PRESETS, generate_home
from helios_sim.injected_faults import Faults, FaultyRobot
from helios_sim.sensor_noise import SENSORS
from helios_sim.settings import Settings
from helios_sim.world import World
from pydantic import ValidationError

HOME = generate_home(3, PRESETS["demo-v1"])


@pytest.fixture
def world() -> Iterator[World]:
    world = World(HOME)
    yield world
    world.close()


def checked(world: World, faults: str, drive: bool) -> dict[str, Finding]:
    found = check_driver(FaultyRobot(world, Faults.of(faults)), drive)
    return {finding.name: finding for finding in found}


def wrong(found: dict[str, Finding]) -> set[str]:
    return {name for name, finding in found.items() if finding.verdict == "wrong"}


def test_each_fault_is_found_with_its_size_and_in_words(world: World) -> None:
    text = "pitch_deg=1,roll_deg=-1,height_m=0.03,delay_ms=40,shift_px=4,turn_percent=3"
    found = checked(world, text, drive=False)
    sizes = {
        "pitch": 1.0,
        "roll": -1.0,
        "height": 0.03,
        "time offset": 0.04,
        "depth-colour registration": 4.0,
        "heading drift": 10.8,
    }
    assert wrong(found) == set(sizes)
    for name, size in sizes.items():
        assert found[name].value == pytest.approx(size, rel=0.2), found[name]
    assert found["pitch"].words == "the camera looks 1.0 deg further down than its pose says"
    assert found["time offset"].words.endswith("ms older than their poses")


def test_a_drive_tells_depth_scale_from_height(world: World) -> None:
    found = checked(world, "depth_percent=1", drive=True)
    assert wrong(found) == {"depth scale"}
    assert found["depth scale"].value == pytest.approx(1.0, rel=0.2)


def test_nothing_is_wrong_with_a_healthy_robot_with_noisy_sensors() -> None:
    world = World(HOME, sensor=SENSORS["realistic"])
    try:
        found = checked(world, "", drive=True)
    finally:
        world.close()
    assert wrong(found) == set()
    assert {finding.verdict for finding in found.values()} == {"ok"}


def test_images_in_the_middle_of_a_turn_leave_the_physics_as_it_is(world: World) -> None:
    other = World(HOME)
    try:
        result, seen = world.act_and_watch(Turn(0.5), "1", 20.0)
        assert result == other.act(Turn(0.5), "1")
        a, b = world.capture(), other.capture()
    finally:
        other.close()
    np.testing.assert_array_equal(a.depth_m, b.depth_m)
    np.testing.assert_array_equal(a.T_world_cam, b.T_world_cam)
    assert len(seen) >= 5
    stamps = [capture.stamp_ns for capture in seen]
    assert stamps == sorted(set(stamps))


def test_the_world_takes_known_faults_alone() -> None:
    assert str(Faults.of("delay_ms=40, pitch_deg=2")) == "pitch_deg=2,delay_ms=40"
    assert Faults.of("") == Faults()
    for text in ("pitch=2", "pitch_deg", "pitch_deg=much", "pitch_deg=nan"):
        with pytest.raises(InvalidInput, match="is no fault"):
            Faults.of(text)
    with pytest.raises(ValidationError, match="is no fault"):
        Settings.model_validate({"faults": "pitch=2"})
