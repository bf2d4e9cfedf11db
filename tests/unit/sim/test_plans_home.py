"""Homes of plans: doors, rooms, furniture, levels, household things."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helios_core.errors import InvalidInput, Unavailable
from helios_sim.episode_tracker import episode_of
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.home.task_sampling import NoTask
from helios_sim.plans import DrawnHome, PlanSource, drawn_home, home_of_plan
from helios_sim.plans.furniture_classes import class_of, opening_kind, word_class
from helios_sim.plans.plan_summary import summary
from helios_sim.world import World

from scripts.generate_example_flat import OUT, example_flat
from tests.unit.sim.plan_files import LEFT, RIGHT, TWO_ROOMS, door, drawn, piece, room, write_plan


@pytest.fixture(scope="module")
def flat() -> DrawnHome:
    return drawn_home(PlanSource.of(OUT))


def test_the_example_is_what_its_script_writes() -> None:
    assert OUT.read_bytes() == example_flat()


def test_the_example_keeps_its_rooms_doors_and_furniture(flat: DrawnHome) -> None:
    kinds = [room.kind for room in flat.home.rooms]
    assert kinds == ["kitchen", "hallway", "bathroom", "office", "living room", "bedroom"]
    assert len(flat.doors.open_doors) == 5
    assert [opening.name for opening, _ in flat.doors.shut] == ["Haustür"]
    assert not flat.unreachable_rooms()
    classes = {placed.class_name for placed in flat.furnishing.pieces}
    assert {"fridge", "bed", "TV stand", "washing machine", "shoe rack", "desk"} <= classes
    assert "furniture" not in classes
    assert {p.source for p in flat.furnishing.pieces} == {"own model", "our shape"}


def test_furniture_does_not_depend_on_the_seed_and_things_do(flat: DrawnHome) -> None:
    source = PlanSource.of(OUT)
    first, again, other = (home_of_plan(source, seed) for seed in (1, 1, 2))
    assert first.structure_hash() == again.structure_hash()
    assert first.drawn_hash() == other.drawn_hash() == flat.home.drawn_hash()
    assert first.structure_hash() != other.structure_hash()


def test_a_task_in_the_example_can_be_solved() -> None:
    home = home_of_plan(PlanSource.of(OUT), 3)
    world = World(home, episode_of(home, 3), colored=False)
    try:
        done = GroundTruthSolver(world).run()
    finally:
        world.close()
    assert done.success
    assert done.collisions == 0


def test_every_body_has_a_class(flat: DrawnHome) -> None:
    model = flat.home.spec().compile()
    names = [model.body(k).name for k in range(1, model.nbody)]
    assert sorted(names) == sorted(flat.home.body_names())
    assert {flat.home.class_of(name) for name in names} >= {"wall", "floor", "window", "door"}
    mujoco.mj_forward(model, mujoco.MjData(model))


def test_a_narrow_door_is_named_with_the_room_behind_it(tmp_path: Path) -> None:
    home = drawn(tmp_path / "a.sh3d", door(400, 250, width=55), piece("Table", 600, 250))
    lines = "\n".join(summary(home))
    assert [r.kind for r in home.unreachable_rooms()] == ["kitchen"]
    assert "cannot reach: Kitchen" in lines
    assert "0.55 m wide" in lines


def test_the_robot_starts_in_the_largest_part(tmp_path: Path) -> None:
    box = piece("Box", 600, 250, (200, 300, 200))
    home = drawn(tmp_path / "a.sh3d", box).home  # no door between the rooms
    assert home.rooms[0].contains(*home.start_pose[:2])


def test_a_door_to_the_outside_stays_shut(tmp_path: Path) -> None:
    home = drawn(tmp_path / "a.sh3d", door(400, 250), door(800, 250)).home
    free, origin = home.free_space(0.0)
    assert not free[int((-2.5 - origin[1]) / 0.05), int((8.0 - origin[0]) / 0.05)]
    assert "door" in {item.class_name for item in home.fixtures}


def test_hidden_outdoor_and_small_pieces_are_left_out(tmp_path: Path) -> None:
    home = drawn(
        tmp_path / "a.sh3d",
        piece("Hidden table", 200, 250, visible="false"),
        piece("Garden bench", 2000, 250),
        piece("Vase", 200, 300, (12, 12, 30), elevation=75),
        piece("Table", 600, 250),
    )
    assert [p.piece.name for p in home.furnishing.pieces] == ["Table"]
    lines = "\n".join(summary(home))
    assert "hidden in the plan" in lines
    assert "outside every room" in lines


def test_groups_are_taken_apart_and_follow_their_visibility(tmp_path: Path) -> None:
    inner = piece("Table", 600, 250) + piece("Chair", 600, 320, (40, 40, 90))
    nested = piece("Set", 600, 250, tag="furnitureGroup", inner=inner)
    hidden = piece(
        "Set", 200, 250, tag="furnitureGroup", inner=piece("Sofa", 200, 250), visible="false"
    )
    outer = piece("All", 600, 250, tag="furnitureGroup", inner=nested)
    home = drawn(tmp_path / "a.sh3d", outer, hidden)
    assert sorted(p.class_name for p in home.furnishing.pieces) == ["chair", "dining table"]


def test_what_hangs_high_does_not_block_and_what_lies_flat_neither(tmp_path: Path) -> None:
    home = drawn(
        tmp_path / "a.sh3d",
        door(400, 250),
        piece("Pendant lamp", 200, 250, (60, 60, 50), elevation=200, tag="light"),
        piece("Rug", 600, 250, (200, 200, 1)),
    ).home
    assert [item.blocks for item in home.fixtures if item.class_name != "door"] == [False, False]


def test_the_level_with_the_most_rooms_is_taken_unless_another_is_named(tmp_path: Path) -> None:
    levels = (
        "<level id='g' name='Ground' elevation='0' height='250' floorThickness='12'/>"
        "<level id='u' name='Upper' elevation='262' height='250' floorThickness='12'/>"
    )
    upper = TWO_ROOMS.replace("<wall ", "<wall level='u' ")
    ground = TWO_ROOMS.replace("<wall ", "<wall level='g' ")
    parts = (
        levels,
        ground,
        upper,
        room("Hall", LEFT, "g"),
        room("Bedroom", LEFT, "u"),
        room("Bath", RIGHT, "u"),
        piece("Table", 200, 250, level="g"),
    )
    path = write_plan(tmp_path / "a.sh3d", parts)
    best = drawn_home(PlanSource.of(path))
    assert best.plan.level == "Upper"
    assert not best.furnishing.pieces
    named = drawn_home(PlanSource.of(path, "ground"))
    assert [p.class_name for p in named.furnishing.pieces] == ["dining table"]
    with pytest.raises(InvalidInput, match="'Ground', 'Upper'"):
        drawn_home(PlanSource.of(path, "Cellar"))
    assert PlanSource.of(path).kind != PlanSource.of(path, "ground").kind


def test_a_home_without_furniture_has_no_task_but_opens(tmp_path: Path) -> None:
    write_plan(tmp_path / "a.sh3d", (TWO_ROOMS, room("Kitchen", LEFT)))
    home = home_of_plan(PlanSource.of(tmp_path / "a.sh3d"), 0)
    with pytest.raises(NoTask, match="draw tables"):
        home.sample_episode(np.random.default_rng(0))


def test_a_file_beside_the_plan_says_where_things_lie(tmp_path: Path) -> None:
    parts = (
        TWO_ROOMS,
        room("Kitchen", LEFT),
        door(400, 250),
        piece("Table", 200, 250, (120, 80, 75)),
        piece("Nightstand", 320, 100, (50, 40, 55)),
    )
    path = write_plan(tmp_path / "a.sh3d", parts)
    beside = path.with_suffix(".toml")
    beside.write_text(
        '[[things]]\nclass = "mug"\nat_m = [1.8, 2.4]\n'
        '[[things]]\nclass = "book"\non = "nightstand"\n'
    )
    home = home_of_plan(PlanSource.of(path), 0)
    mug, book = home.objects
    assert (mug.class_name, mug.position_m[:2]) == ("mug", pytest.approx((1.8, -2.4), abs=0.01))
    assert home.receptacle(book.receptacle).class_name == "nightstand"
    for text, match in (
        ('[[things]]\nclass = "mug"\nat_m = [0.3, 0.3]\n', "no furniture"),
        ('[[things]]\nclass = "dragon"\non = "nightstand"\n', "no household thing"),
        ('[[things]]\nclass = "mug"\non = "sofa"\n', "within the robot's reach"),
        ('[[things]]\nclass = "mug"\nat_m = [nan, 1]\n', "two numbers"),
        ("things = 3\n", "wanted 1 to"),
        ("[[things", "no TOML"),
        (f'[[things]]\nclass = "mug"\nat_m = [{"9" * 400}, 1]\n', "two numbers"),
        (f"things = {'[' * 5000}", "no TOML"),
    ):
        beside.write_text(text)
        with pytest.raises(InvalidInput, match=match):
            home_of_plan(PlanSource.of(path), 0)


def test_things_that_changed_since_the_run_began_are_refused(tmp_path: Path) -> None:
    parts = (
        TWO_ROOMS,
        room("Kitchen", LEFT),
        door(400, 250),
        piece("Table", 200, 250, (120, 80, 75)),
    )
    path = write_plan(tmp_path / "a.sh3d", parts)
    path.with_suffix(".toml").write_text('[[things]]\nclass = "mug"\non = "dining table"\n')
    source = PlanSource.of(path)
    assert home_of_plan(source, 0).objects
    path.with_suffix(".toml").write_text('[[things]]\nclass = "book"\non = "dining table"\n')
    with pytest.raises(Unavailable, match="has changed since the run began"):
        home_of_plan(source, 1)


def test_a_plan_that_changed_since_is_refused(tmp_path: Path) -> None:
    path = write_plan(tmp_path / "a.sh3d", (TWO_ROOMS, room("Kitchen", LEFT)))
    source = PlanSource.of(path)
    path.with_suffix(".toml").write_text('[[things]]\nclass = "mug"\non = "dining table"\n')
    now = PlanSource.of(path).things_sha256[:12]
    with pytest.raises(Unavailable, match=rf"a\.toml is no longer the file .*none, now {now}\)"):
        drawn_home(source)
    write_plan(path, (TWO_ROOMS, room("Bath", LEFT)))
    now = PlanSource.of(path).sha256[:12]
    with pytest.raises(Unavailable, match=rf"a\.sh3d is no longer the file .*now {now}\)"):
        drawn_home(source)


@pytest.mark.parametrize(
    ("catalog_id", "name", "expected"),
    [
        ("eTeks#sofa", "Meuble du salon", "sofa"),  # the number comes first
        ("eTeks#bedsideTable", "", "nightstand"),
        ("", "Canapé d'angle 3", "sofa"), ("", "Küchentisch rund", "dining table"),
        ("", "Mesita de noche", "nightstand"), ("", "Lavastoviglie", "dishwasher"),
        ("", "Guarda-roupa", "wardrobe"), ("", "Boekenkast IKEA", "bookcase"),
        ("", "Nattduksbord", "nightstand"), ("", "Reol", "shelf"), ("", "Kjøleskap", "fridge"),
        ("", "Pyykinpesukone", "washing machine"), ("", "Łóżko 160x200", "bed"),
        ("", "Psací stůl", "desk"), ("", "Práčka", "washing machine"),
        ("", "Hűtőszekrény", "fridge"), ("", "Noptieră", "nightstand"), ("", "Ormar", "wardrobe"),
        ("", "Nočna omarica", "nightstand"), ("", "Хладилник", "fridge"), ("", "Диван", "sofa"),
        ("", "Холодильник", "fridge"), ("", "Καναπές", "sofa"), ("", "Buzdolabı", "fridge"),
        ("", "Giường", "bed"), ("", "Kulkas", "fridge"), ("", "双人床", "bed"),
        ("", "ソファ", "sofa"), ("", "침대", "bed"), ("", "ثلاجة", "fridge"),
        ("", "Šaldytuvas", "fridge"), ("", "Külmkapp", "fridge"), ("", "Capacitor", "furniture"),
    ],
)  # fmt: skip
def test_classes_by_number_then_by_name_in_any_language(
    catalog_id: str, name: str, expected: str
) -> None:
    assert class_of(catalog_id, name, (1.0, 0.8, 0.9)) == expected


def test_size_divides_tables_and_cabinets() -> None:
    assert class_of("", "Table", (1.0, 0.6, 0.45)) == "coffee table"
    assert class_of("", "Table", (0.4, 0.4, 0.6)) == "side table"
    assert class_of("", "Schrank", (1.0, 0.6, 2.0)) == "wardrobe"
    assert class_of("", "Schrank", (1.0, 0.6, 0.8)) == "sideboard"


def test_french_windows_are_doors_and_low_windows_are_not() -> None:
    assert opening_kind("eTeks#frenchWindow85x200", "French window", 0.0, 2.0) == "door"
    assert opening_kind("", "Fenêtre", 0.0, 2.0) == "window"
    assert opening_kind("", "Something", 0.0, 2.1) == "door"
    assert opening_kind("", "Something", 0.9, 1.2) == "window"
    assert math.isclose(len(word_class("x y z")), 0)
