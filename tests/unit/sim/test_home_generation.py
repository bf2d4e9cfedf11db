"""Tests complete homes of the demo's preset."""

import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_sim.home import PRESETS, Home, generate_home
from helios_sim.home import freespace as fs
from helios_sim.home.furnished_floor import surface_points
from numpy.typing import NDArray

DEMO = PRESETS["demo-v1"]
SEEDS = tuple(range(10))
CELL_M = 0.05


@pytest.fixture(scope="module")
def homes() -> dict[int, Home]:
    return {seed: generate_home(seed, DEMO) for seed in SEEDS}


def reachable_cells(home: Home, radius_m: float) -> tuple[NDArray[np.bool_], NDArray, NDArray]:
    """Cells connected with the start for a disc of that radius, and their x and y [n]."""
    free, origin = home.free_space(radius_m, CELL_M)
    region = fs.largest_region(free)
    column = int((home.start_pose[0] - origin[0]) / CELL_M)
    row = int((home.start_pose[1] - origin[1]) / CELL_M)
    assert region[row, column], "the start pose must be in the largest free region"
    rows, columns = np.nonzero(region)
    return region, origin[0] + (columns + 0.5) * CELL_M, origin[1] + (rows + 0.5) * CELL_M


@pytest.mark.parametrize("seed", SEEDS)
def test_a_home_has_the_rooms_receptacles_and_objects_of_its_preset(
    homes: dict[int, Home], seed: int
) -> None:
    home = homes[seed]
    assert len(home.rooms) >= 4
    assert len(home.receptacles) >= 12
    assert len({item.class_name for item in home.receptacles}) >= 6
    assert len(home.objects) >= 15
    assert len({thing.class_name for thing in home.objects}) >= 8
    assert all(1.1 <= door.width_m <= 1.3 for door in home.doorways)
    for thing in home.objects:
        assert 0.04 <= max(thing.size_m) <= 0.25, thing.name
        bottom = thing.position_m[2] - thing.size_m[2] / 2
        assert 0.29 <= bottom <= 1.2, thing.name
        assert home.rooms[home.receptacle(thing.receptacle).room].contains(*thing.position_m[:2])


@pytest.mark.parametrize("seed", SEEDS)
def test_after_2_s_every_object_is_still_on_its_receptacle(
    homes: dict[int, Home], seed: int
) -> None:
    home = homes[seed]
    model = home.spec(visuals=False).compile()
    data = mujoco.MjData(model)
    for _ in range(round(2.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    touching = set()
    for contact in data.contact[: data.ncon]:
        names = [model.body(model.geom_bodyid[g]).name for g in (contact.geom1, contact.geom2)]
        touching |= {tuple(names), tuple(reversed(names))}
    for thing in home.objects:
        drift = np.linalg.norm(data.body(thing.name).xpos - thing.position_m)
        assert drift < 0.05, thing.name
        assert (thing.name, thing.receptacle) in touching


@pytest.mark.parametrize("seed", SEEDS)
def test_a_robot_reaches_and_sees_every_object_and_receptacle(
    homes: dict[int, Home], seed: int
) -> None:
    home = homes[seed]
    model = home.spec(visuals=False).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    _, x, y = reachable_cells(home, DEMO.passage_radius_m)
    for thing in home.objects:
        near = np.nonzero(np.hypot(x - thing.position_m[0], y - thing.position_m[1]) <= 0.75)[0]
        seen = any(
            first_body(model, data, (x[k], y[k], 1.31), (*thing.position_m[:2], height))
            == thing.name
            for k in near
            for height in (thing.position_m[2], thing.position_m[2] + 0.4 * thing.size_m[2])
        )
        assert seen, thing.name
    for item in home.receptacles:
        surface = item.surfaces[0]
        target = (*surface.center_xy, surface.height_m - 0.01)
        near = np.nonzero(np.hypot(x - target[0], y - target[1]) <= 1.5)[0]
        standing = {t.name for t in home.objects if t.receptacle == item.name}
        names = {first_body(model, data, (x[k], y[k], 1.31), target) for k in near}
        assert names & (standing | {item.name}), item.name


def first_body(model: mujoco.MjModel, data: mujoco.MjData, eye: tuple, target: tuple) -> str:
    geom = np.array([-1], dtype=np.int32)
    start = np.array(eye, dtype=np.float64)
    mujoco.mj_ray(model, data, start, np.array(target) - start, None, 1, -1, geom)
    return model.body(model.geom_bodyid[geom[0]]).name if geom[0] >= 0 else ""


@pytest.mark.parametrize("seed", SEEDS)
def test_every_room_and_doorway_is_reachable_with_10_cm_to_spare(
    homes: dict[int, Home], seed: int
) -> None:
    home = homes[seed]
    region, x, y = reachable_cells(home, 0.4)
    for room in home.rooms:
        inside = (x > room.x0) & (x < room.x1) & (y > room.y0) & (y < room.y1)
        assert inside.sum() * CELL_M**2 > 1.0, room
    for door in home.doorways:
        assert region[fs.cell_of(door.x, door.y, home.bounds, CELL_M)]


@pytest.mark.parametrize("seed", SEEDS)
def test_every_receptacle_has_room_for_one_more_object_in_reach(
    homes: dict[int, Home], seed: int
) -> None:
    home = homes[seed]
    _, x, y = reachable_cells(home, DEMO.passage_radius_m)
    for item in home.receptacles:
        spots = np.concatenate([surface_points(surface, 0.0) for surface in item.surfaces])
        away = np.hypot(x[:, None] - spots[:, 0], y[:, None] - spots[:, 1]).min(axis=0)
        spots = spots[away < 0.75]
        for thing in home.objects:
            if thing.receptacle == item.name:
                gap = np.hypot(*(spots - thing.position_m[:2]).T) - max(thing.size_m[:2]) / 2
                spots = spots[gap > 0.1]
        assert len(spots) > 0, item.name


def test_the_same_seed_gives_the_same_home_in_another_process(homes: dict[int, Home]) -> None:
    code = (
        "from helios_sim.home import PRESETS, generate_home;"
        "print(generate_home(3, PRESETS['demo-v1']).structure_hash())"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "77", "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == homes[3].structure_hash()


def test_seeds_give_different_homes(homes: dict[int, Home]) -> None:
    assert len({home.structure_hash() for home in homes.values()}) == len(homes)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_object_of_an_episode_stands_on_the_named_start_receptacle(
    homes: dict[int, Home], seed: int
) -> None:
    home = homes[seed]
    for k in range(20):
        episode = home.sample_episode(np.random.default_rng(k))
        places = {
            home.receptacle(thing.receptacle).class_name
            for thing in home.objects
            if thing.class_name == episode.object_class
        }
        assert places == {episode.start_receptacle_class}
        goals = {item.class_name for item in home.receptacles} - places
        assert episode.goal_receptacle_class in goals
        assert episode.instruction == (
            f"Move the {episode.object_class} from the {episode.start_receptacle_class} "
            f"to the {episode.goal_receptacle_class}"
        )


def test_every_body_of_the_model_has_a_class(homes: dict[int, Home]) -> None:
    home = homes[0]
    model = home.spec().compile()
    names = [model.body(k).name for k in range(1, model.nbody)]
    assert sorted(names) == sorted(home.body_names())
    assert home.class_of("floor_0") == "floor"
    assert home.class_of(home.objects[0].name) == home.objects[0].class_name
    with pytest.raises(KeyError, match="no body 'robot'"):
        home.class_of("robot")
    assert model.nmeshface < 60_000


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(InvalidInput, match="-1"):
        generate_home(-1, DEMO)
