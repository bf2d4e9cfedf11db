"""Tests the message of `helios up` about unread variables, and the planner's task folder."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from helios_client.supervision.service_specs import StackOptions
from helios_client.supervision.unknown_variables import unread_variables_message

from tests.helios_up import started
from tests.support import ENDS_WITHIN_S, free_port, wait_until

SMALL_STACK = Path(__file__).parent / "client/client_small_stack.py"


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("HELIOS_PLANER_TAU_G", "HELIOS_PLANNER_TAU_G"),
        ("HELIOS_OBJECT_MAP_STRIDE_PX", "HELIOS_OBJECTMAP_STRIDE_PX"),
        ("HELIOS_MAP_2D_CELL_M", "HELIOS_MAP2D_CELL_M"),
        ("HELIOS_CONFIGG", "HELIOS_CONFIG"),
        ("HELIOS_APIKEY", "HELIOS_API_KEY"),
    ],
)
def test_an_unknown_variable_is_reported_with_a_similar_name(name: str, near: str) -> None:
    assert f"reads {name} (did you mean {near}?); the services are" in unread_variables_message(
        [name, "HOME"]
    )


def test_an_unknown_variable_without_a_similar_name_is_reported_with_the_services() -> None:
    assert "reads HELIOS_HOME; the services are bridge, detector" in unread_variables_message(
        ["HELIOS_HOME"]
    )


def test_variables_that_a_program_or_service_reads_are_not_reported() -> None:
    read = ("CONFIG", "URL", "API_KEY", "RECORD", "TEST_SCREENSHOTS", "PLANNER_TAU_GG", "SPOT_HOST")
    assert (
        unread_variables_message([*(f"HELIOS_{name}" for name in read), "_HELIOS_COMPLETE", "PATH"])
        == ""
    )


def test_unread_variables_are_reported_once_before_the_services_start(tmp_path: Path) -> None:
    log = tmp_path / "up.log"
    argv = [sys.executable, str(SMALL_STACK), str(free_port()), str(tmp_path / "state"), "demo-v1"]
    environment = {"XDG_STATE_HOME": str(tmp_path), "HELIOS_PLANER_TAU_G": "0.2"}
    with started(argv, log, environment):
        wait_until(lambda: "dashboard at" in log.read_text(), ENDS_WITHIN_S, "all are ready")
    said = log.read_text()
    assert said.count("HELIOS_PLANNER_TAU_G") == 1
    assert said.index("HELIOS_PLANNER_TAU_G") < said.index("is ready")


def tasks_dir(stack: StackOptions) -> Path:
    [planner] = (spec for spec in stack.processes() if spec.name == "planner")
    return Path(planner.argv[planner.argv.index("--state-dir") + 1])


def test_each_simulated_home_has_its_own_persistent_task_folder() -> None:
    def of(preset: str, seed: int) -> Path:
        return tasks_dir(
            StackOptions("sim", 7447, Path("state"), port=8080, preset=preset, seed=seed)
        )

    homes = [("demo-v1", 3), ("demo-v1", 5), ("ovmm-v1", 3)]
    assert len({of(*home) for home in homes}) == 3
    assert of("demo-v1", 3) == of("demo-v1", 3) == Path("state/planner/sim-demo-v1-3")
    assert of("../x", 3).parent == Path("state/planner")


def test_another_robot_does_not_use_the_task_folder_of_a_simulated_home() -> None:
    assert tasks_dir(StackOptions("spot", 7447, Path("state"), port=8080)) == Path("state/planner")
