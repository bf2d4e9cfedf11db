"""Tests homes with baked furniture."""

from __future__ import annotations

import os

os.environ.setdefault("MUJOCO_GL", "egl")


from pathlib import Path

import mujoco
import numpy as np
import pytest
from helios_client.cli import run
from helios_client.supervision.service_specs import StackOptions
from helios_core.errors import Unavailable
from helios_sim.assets import FurnitureReplacement, realistic
from helios_sim.assets.asset_baking import bake
from helios_sim.assets.asset_pack import Model
from helios_sim.assets.home_furnishing import FURNITURE_SCALE, furniture_scale, thing_scale
from helios_sim.episode_tracker import episode_of
from helios_sim.home import PRESETS, Home, generate_home
from helios_sim.home.catalogs import CATALOGS
from helios_sim.home.color_palette import draw_palette
from helios_sim.home.home_types import CollisionPrimitive, Receptacle, Shape, Surface
from helios_sim.settings import Settings
from helios_sim.world import World
from pydantic import ValidationError

from tests.unit.sim.assets_library import CHOICES, write_library

DEMO = PRESETS["demo-v1"]


@pytest.fixture(scope="module")
def furniture_models(tmp_path_factory: pytest.TempPathFactory) -> FurnitureReplacement:
    folder = tmp_path_factory.mktemp("furniture")
    write_library(folder / "source")
    bake(folder / "source", folder / "cache", CHOICES)
    return realistic(folder / "cache")


@pytest.fixture(scope="module")
def homes(furniture_models: FurnitureReplacement) -> list[Home]:
    return [generate_home(seed, DEMO, furniture_models) for seed in (0, 1)]


def baked_furniture(home: Home) -> list[Receptacle]:
    return [
        item
        for item in home.receptacles
        if any(visual.material.picture is not None for visual in item.shape.visuals)
    ]


def test_a_home_with_furniture_models_names_the_pack_in_its_preset(homes: list[Home]) -> None:
    for home in homes:
        assert home.preset.name == "demo-v1+sweethome3d"
        assert {item.class_name for item in baked_furniture(home)} & {"dining table", "nightstand"}
        assert len(home.objects) >= DEMO.objects[0]


def test_the_same_seed_and_pack_give_the_same_home(
    furniture_models: FurnitureReplacement, homes: list[Home]
) -> None:
    assert generate_home(1, DEMO, furniture_models).structure_hash() == homes[1].structure_hash()


def test_a_home_without_furniture_models_has_no_baked_furniture(
    homes: list[Home], sim_home: Home
) -> None:
    assert sim_home.preset is DEMO
    assert not baked_furniture(sim_home)
    assert generate_home(0, DEMO, None).structure_hash() == sim_home.structure_hash()


def test_objects_on_baked_furniture_stay_in_place(homes: list[Home]) -> None:
    for home in homes:
        model = home.spec(visuals=False).compile()
        data = mujoco.MjData(model)
        for _ in range(500):
            mujoco.mj_step(model, data)
        for thing in home.objects:
            drift = np.linalg.norm(data.body(thing.name).xpos - thing.position_m)
            assert drift < 0.05, thing.name


def test_baked_furniture_is_rendered_with_its_own_texture(homes: list[Home]) -> None:
    home = homes[0]
    model = home.spec().compile()
    names = [model.tex(k).name for k in range(model.ntex)]
    assert sum(name.startswith("picture_") for name in names) == 1
    try:
        world = World(home, episode_of(home, 0))
    except Unavailable as error:
        pytest.skip(f"no offscreen graphics here: {error}")
    try:
        assert world.capture().color.std() > 10
    finally:
        world.close()


def shape(size: tuple[float, float, float], *surfaces: Surface, ball: bool = False) -> Shape:
    kind = "sphere" if ball else "box"
    return Shape(
        size, (), (CollisionPrimitive(kind, (1, 1, 1), (0, 0, 0)),), (1, 1, 1), surfaces, rolls=ball
    )


def table(size: tuple[float, float, float], top_m: float) -> Model:
    surface = (0.0, 0.0, size[0] / 2, size[1] / 2, top_m)
    return Model("k", ("table",), "", "", "", size, (1, 1, 1), (), (surface,), ())


def test_furniture_is_scaled_on_each_axis_to_the_drawn_size_and_surface_height() -> None:
    drawn = shape((1.2, 0.8, 0.75), Surface((0, 0), (0.6, 0.4), 0, 0.75))
    scale = furniture_scale(table((1.0, 0.9, 1.1), 0.8), drawn)
    assert scale == pytest.approx([1.2, 0.8 / 0.9, 0.75 / 0.8])


@pytest.mark.parametrize(
    "size",
    [(2.0, 0.8, 0.75), (1.2, 1.4, 0.75), (0.9, 1.1, 0.75)],
    ids=["too wide", "too deep", "too stretched"],
)
def test_furniture_that_does_not_fit_is_not_used(size: tuple[float, float, float]) -> None:
    drawn = shape((1.2, 0.7, 0.75), Surface((0, 0), (0.6, 0.4), 0, 0.75))
    assert furniture_scale(table(size, 0.75), drawn) is None


def test_a_model_for_a_receptacle_needs_a_surface_in_reach() -> None:
    drawn = shape((1.2, 0.8, 2.0), Surface((0, 0), (0.6, 0.4), 0, 1.9))
    assert furniture_scale(table((1.2, 0.8, 1.9), 1.9), drawn) is None
    assert furniture_scale(table((1.2, 0.8, 1.9), 1.9), shape((1.2, 0.8, 2.0))) is not None


def test_objects_keep_their_proportions_and_balls_take_the_drawn_size() -> None:
    mug = table((0.1, 0.08, 0.12), 0.1)
    assert thing_scale(mug, shape((0.09, 0.09, 0.06))) == pytest.approx([0.75] * 3)
    assert thing_scale(mug, shape((0.01, 0.01, 0.01))) is None
    assert thing_scale(mug, shape((0.2, 0.2, 0.2), ball=True)) == pytest.approx([2, 2.5, 5 / 3])


@pytest.mark.parametrize("name", sorted(CATALOGS))
def test_every_baked_shape_stays_within_its_limits(
    furniture_models: FurnitureReplacement, name: str
) -> None:
    catalog, wrapped = CATALOGS[name], furniture_models.applied_to(CATALOGS[name])
    for class_name in ("dining table", "nightstand", "dresser", "coffee table"):
        for seed in range(6):
            rng = np.random.default_rng(seed)
            palette = draw_palette(rng)
            state = rng.bit_generator.state
            drawn = catalog.receptacles[class_name][1](rng, palette)
            rng.bit_generator.state = state
            got = wrapped.receptacles[class_name][1](rng, palette)
            assert (np.array(got.size_m[:2]) <= 1.121 * np.array(drawn.size_m[:2])).all()
            for surface in got.surfaces:
                assert surface.height_m <= got.size_m[2] + 1e-6
            if got.color != drawn.color:
                keys = furniture_models.pack.of_class(class_name)
                scales = [np.array(got.size_m) / m.size_m for m in keys]
                low, high = FURNITURE_SCALE
                assert any((s > low - 1e-6).all() and (s < high + 1e-6).all() for s in scales)


def test_other_kinds_of_furniture_are_refused() -> None:
    with pytest.raises(ValidationError, match="furniture"):
        Settings.model_validate({"furniture": "golden"})


def test_the_stack_passes_the_furniture_option_to_the_world_and_refuses_other_kinds() -> None:
    assert run(["up", "--furniture", "golden"]) == 2
    stack = StackOptions("sim", 7447, Path("state"), furniture="realistic")
    (world,) = (spec for spec in stack.processes() if spec.name == "world")
    assert "--furniture realistic" in " ".join(world.argv)
