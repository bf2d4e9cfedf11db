"""Costs, value maps and points that go to ROS; templates of actions; interface packages."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from helios_client.supervision.ros2_python import ros2_python
from helios_client.supervision.service_specs import StackOptions
from helios_client.usage_errors import UsageError
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN, MapView
from helios_core.types import FrameId
from helios_ros2.action_call import filled, set_fields
from helios_ros2.interface_build import corrected
from helios_ros2.interface_definitions import DISTRIBUTIONS, packages
from helios_ros2.map_arrays import LEGEND_PX, SCALE, cloud, costs, value_cells, value_picture
from helios_ros2.map_output import topic_name
from helios_ros2.rclpy_loading import interface
from helios_ros2.settings import Ros2Settings
from helios_ros2.task_interface import submit_request
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

CELL_M = 0.05


def view(occupancy: np.ndarray) -> MapView:
    empty = np.zeros(occupancy.shape, np.float32)
    return MapView(
        1, FrameId("", 0, 1), "", CELL_M, (0.0, 0.0), occupancy.astype(np.int8), empty > 0, empty,
        {}, (), (0.0, 0.0, 0.0), np.zeros((0, 2), np.float32), 0.0, 0.0,
    )  # fmt: skip


def test_costs_fall_with_the_distance_from_an_obstacle() -> None:
    occupancy = np.full((41, 41), FREE)
    occupancy[20, 20], occupancy[0, 0] = OCCUPIED, UNKNOWN
    cost = costs(view(occupancy), 0.25)
    row = cost[20, 20:].astype(int)
    assert (row[0], row[5], row[0:6].min()) == (100, 99, 99)  # the radius is five cells
    assert (np.diff(row) <= 0).all()
    assert row[-1] < 20
    assert cost[0, 0] == -1


def test_a_map_without_obstacles_costs_nothing() -> None:
    assert not costs(view(np.full((5, 5), FREE)), 0.25).any()


@given(hnp.arrays(np.float32, (4, 5)))
def test_values_are_percent_or_minus_one_for_any_numbers(value: np.ndarray) -> None:
    cells = value_cells(value)
    assert cells.min() >= -1
    assert cells.max() <= 100
    sound = np.isfinite(value)
    assert (cells[sound & (value <= 0)] == -1).all()


def test_a_value_map_is_a_picture_with_north_up_and_a_legend_below() -> None:
    occupancy = np.full((30, 40), FREE)
    value = np.full((30, 40), 0.2, np.float32)
    value[29] = 0.9  # the highest y
    rgb = value_picture(view(occupancy), value, "kitchen table")
    assert rgb.shape == (30 * SCALE + LEGEND_PX, 40 * SCALE, 3)
    assert (rgb[0, 0] != rgb[29 * SCALE, 0]).any()
    np.testing.assert_array_equal(rgb[30 * SCALE + 1, -1], rgb[0, 0])  # the legend's high end


def test_points_have_colour_class_and_object() -> None:
    reply = pb.GaussiansReply(
        count=2,
        class_names=["other", "cup"],
        means_m=np.array([[1, 2, 3], [np.nan, 0, 0]], "<f4").tobytes(),
        colors=np.array([[1, 2, 3], [0, 0, 0]], "u1").tobytes(),
        instances=np.array([7, 8], "<u4").tobytes(),
        concentration=np.array([[1, 5], [5, 1]], "<f4").tobytes(),
    )
    [point] = cloud(reply)  # one that is not finite is left out
    assert (point["rgb"], point["class"], point["object"]) == (0x010203, 1, 7)
    reply.count = 3
    with pytest.raises(InvalidInput, match="wanted 36"):
        cloud(reply)


@given(st.text())
def test_any_layer_has_a_valid_topic_name(text: str) -> None:
    name = topic_name(text)
    assert name.isascii()
    assert name.replace("_", "a").isalnum()
    assert not name[0].isdigit()


@given(st.lists(st.text(), min_size=2, max_size=2, unique=True))
def test_two_layers_never_share_a_topic(texts: list[str]) -> None:
    assert topic_name(texts[0]) != topic_name(texts[1])


def test_layers_that_differ_in_punctuation_or_letters_beyond_ascii_have_topics_of_their_own() -> (
    None
):
    names = [
        topic_name(text) for text in ("Tür", "T-r", "T r", "T_r", "椅子", "桌子", "layer", "_x")
    ]
    assert len(set(names)) == len(names)
    assert names[2].startswith("T_r_")
    for plain in ("T_r", "layer", "pick", "goal_region2"):
        assert topic_name(plain) == plain


# --- tasks and actions ----------------------------------------------------------------------------
def test_a_task_is_an_instruction_or_json() -> None:
    assert submit_request(" find the cup ").instruction == "find the cup"
    assert submit_request('{"instruction": "find the cup", "priority": 3}').priority == 3
    own = '{"instruction": "find the cup", "settings": {"alpha_d": 0.01, "pick_rule": "ovmm"}}'
    assert dict(submit_request(own).settings) == {"alpha_d": "0.01", "pick_rule": "ovmm"}
    for wrong in (
        "{nonsense",
        '{"instrction": "x"}',
        '{"instruction": 3}',
        '{"instruction": "x", "settings": [1]}',
    ):
        with pytest.raises(InvalidInput, match="send an instruction"):
            submit_request(wrong)


def test_a_task_with_too_many_levels_is_refused_with_the_reason() -> None:
    for deep in ("[" * 200_000, '{"a":' * 200_000):
        with pytest.raises(InvalidInput, match="too many levels; send an instruction"):
            submit_request('{"settings": ' + deep)


class Point:
    def __init__(self) -> None:
        self.x, self.name = 0.0, ""

    def get_fields_and_field_types(self) -> dict[str, str]:
        return {"x": "double", "name": "string"}


class Goal:
    def __init__(self) -> None:
        self.target, self.order = Point(), 0

    def get_fields_and_field_types(self) -> dict[str, str]:
        return {"target": "Point", "order": "int32"}


def test_a_goal_is_filled_from_a_table() -> None:
    template = {"target": {"x": "{x}", "name": "the {name}"}, "order": 4}
    goal = Goal()
    set_fields(goal, filled(template, {"x": 1.25, "name": "cup"}), "the goal")
    assert (goal.target.x, goal.target.name, goal.order) == (1.25, "the cup", 4)


@pytest.mark.parametrize(
    ("table", "said"),
    [({"targt": {}}, "it has target, order"), ({"order": "many"}, "cannot be 'many'")],
)
def test_a_wrong_table_is_refused_by_field(table: dict, said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        set_fields(Goal(), table, "the goal")


def test_a_wrong_placeholder_is_refused_with_the_right_ones() -> None:
    with pytest.raises(InvalidInput, match=r"\{x\}, \{name\}"):
        filled("{z}", {"x": 1, "name": "cup"})


@pytest.mark.parametrize("name", ["Image", "a/b/C", "no_such_pkg/msg/Image"])
def test_a_type_that_is_not_installed_is_refused(name: str) -> None:
    with pytest.raises(InvalidInput, match=r"is no ROS type|is not installed"):
        interface(name)


def test_the_table_of_an_action_is_read_from_the_settings_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text(
        '[ros2.pick]\naction = "/pick"\ntype = "a/action/B"\n[ros2.pick.goal]\nx = "{x}"\n'
    )
    monkeypatch.setenv("HELIOS_CONFIG", str(file))
    pick = Ros2Settings.read().pick
    assert pick is not None
    assert (pick.action, pick.goal) == ("/pick", {"x": "{x}"})
    file.write_text('[ros2.pick]\naction = "/pick"\ntyp = "a/action/B"\n')
    with pytest.raises(InvalidInput, match=r"pick\.typ"):
        Ros2Settings.read()


# --- interfaces and processes ---------------------------------------------------------------------
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_every_package_has_a_manifest_and_names_its_files(distribution: str) -> None:
    for package in packages(distribution):
        manifest = ET.fromstring(package.manifest)
        assert manifest.findtext("name") == package.name
        assert all(f'"{name}"' in package.build_file for name in package.files)
        for name, text in package.files.items():
            assert text.count("---\n") == (2 if name.endswith(".action") else 0)


def test_the_build_machines_folders_are_replaced_in_cmake_files() -> None:
    text = (
        "/opt/python/cp311-cp311/include/python3.11;"
        "/opt/python/cp312-cp312/lib/python3.12/site-packages/numpy/_core/include"
    )
    assert corrected(text, "/usr/include/p", "/v/numpy") == "/usr/include/p;/v/numpy"


def test_only_the_processes_that_use_ros_get_its_interpreter() -> None:
    options = StackOptions(
        "ros2", 7447, Path("state"), port=8080, ros2_python="/ros/python", ros2_output=True
    )
    by_ros = {spec.name for spec in options.processes() if spec.argv[0] == "/ros/python"}
    assert by_ros == {"bridge", "ros2"}
    options = StackOptions(
        "sim", 7447, Path("state"), port=8080, ros2_python="/ros/python", ros2_output=True
    )
    assert [s.name for s in options.processes() if s.argv[0] == "/ros/python"] == ["ros2"]


def test_the_interpreter_is_the_chosen_one_or_that_beside_this_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python = tmp_path / ".venv-ros2/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\n")
    python.chmod(0o755)
    assert ros2_python(str(python)) == str(python)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.prefix", str(tmp_path / ".venv"))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert ros2_python("") == str(python)
    python.unlink()
    with pytest.raises(UsageError, match="make ros2-env"):
        ros2_python("")
