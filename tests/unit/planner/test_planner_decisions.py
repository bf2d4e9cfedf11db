"""Eq. 8-10, the pick and place rules, and gaze points, on cases that can be checked by hand."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput, Unavailable
from helios_core.types import ObjectInstance
from helios_planner.decisions.acceptance import act_or_look
from helios_planner.decisions.decision import Act, Do, FrontierOption, ReceptacleOption, ViewOption
from helios_planner.decisions.gain import Gain, normalised_gain
from helios_planner.decisions.global_search import (
    ChosenFrontier,
    FirstSeen,
    SearchMemory,
    as_memory,
    by_objective,
    drawn,
    estimated_value,
    frontier_scale,
    highest_value,
    nearest,
    receptacles_first,
)
from helios_planner.motion_planning.base_placement import (
    GazeRules,
    PlaceRules,
    gaze_points,
    place_spots,
    stand_for,
)
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.motion_planning.path_planner import MotionRules, reach
from helios_planner.settings import GainNorm
from helios_planner.tasks.store import Store
from planner_eye import ROBOT

ALPHA_D = 0.001


def instance(
    id: int = 1,
    center: tuple[float, float, float] = (2.0, 2.0, 0.5),
    size: tuple[float, float, float] = (0.1, 0.1, 0.1),
    score: float = 0.4,
    class_score: float = 0.5,
) -> ObjectInstance:
    return ObjectInstance(
        id, "mug", np.array(center), np.array(size), score, class_score, 0.1, 2, 100, {},
        center[2] + size[2] / 2, np.empty((0, 2)),
    )  # fmt: skip


# --- eq. 8 and 9 ---------------------------------------------------------------------------------
def test_v0_is_the_best_first_seen_value_minus_its_distance_to_the_frontier() -> None:
    seen = {
        1: FirstSeen(0.5, 2.0, (0.0, 0.0)),  # worth 1.0, 3 m away
        2: FirstSeen(0.9, 1.0, (3.0, 4.0)),  # worth 0.9, 4 m away
    }
    assert estimated_value((3.0, 0.0), seen, 0.1) == pytest.approx(1.0 - 0.3)
    assert estimated_value((3.0, 0.0), seen, 1.0) == pytest.approx(-2.0)


def test_the_frontier_scale_is_the_mean_ratio() -> None:
    memory = SearchMemory({1: FirstSeen(0.5, 2.0, (0.0, 0.0))})
    memory.chosen = [ChosenFrontier((0.0, 0.0), 0.25), ChosenFrontier((0.0, 0.0), 0.5)]
    assert frontier_scale(memory, 0.0) == pytest.approx((4.0 + 2.0) / 2)


@pytest.mark.parametrize(
    "memory",
    [
        SearchMemory(),
        SearchMemory({1: FirstSeen(0.5, 2.0, (0.0, 0.0))}),
        SearchMemory({}, [ChosenFrontier((0.0, 0.0), 0.3)]),
        SearchMemory({1: FirstSeen(0.5, 2.0, (0.0, 0.0))}, [ChosenFrontier((0.0, 0.0), 0.0)]),
        SearchMemory(
            {1: FirstSeen(0.5, 2.0, (0.0, 0.0))},
            [ChosenFrontier((0.0, 0.0), 0.5), ChosenFrontier((0.0, 0.0), 0.0)],
        ),
        SearchMemory({1: FirstSeen(0.5, 0.0, (9.0, 0.0))}, [ChosenFrontier((0.0, 0.0), 0.3)]),
        SearchMemory({1: FirstSeen(0.5, 2.0, (0.0, 0.0))}, [ChosenFrontier((0.0, 0.0), 2e-309)]),
    ],
    ids=[
        "nothing",
        "no frontier",
        "no candidate",
        "a value of zero",
        "one of two values of zero",
        "a negative ratio",
        "an infinite ratio",
    ],
)
def test_the_frontier_scale_is_one_where_it_is_not_defined(memory: SearchMemory) -> None:
    assert frontier_scale(memory, 0.1) == 1.0


def test_the_first_record_of_a_receptacle_is_not_overwritten() -> None:
    memory = SearchMemory()
    memory.note(1, FirstSeen(0.4, 1.0, (0.0, 0.0)))
    memory.note(1, FirstSeen(0.9, 9.0, (1.0, 1.0)))
    assert memory.first_seen[1].class_score == 0.4


# --- eq. 10 --------------------------------------------------------------------------------------
def test_the_unit_of_the_gain_decides_how_much_a_metre_weighs() -> None:
    """Two candidates differ by 0.03 in value and by 6 m. Normalised per Gaussian, the weight of a
    metre decides; with the paper's plain sum over 5000 Gaussians it never does."""
    near, far = instance(1), instance(2)

    def winner(alpha_d: float, gaussians: int) -> int:
        gains = (1.00 * gaussians, 1.06 * gaussians)
        norm = "per_gaussian" if gaussians == 1 else "sum"
        options = [
            ReceptacleOption(near, 0.5, normalised_gain(Gain(gains[0], gaussians), norm), 2.0),
            ReceptacleOption(far, 0.5, normalised_gain(Gain(gains[1], gaussians), norm), 8.0),
        ]
        return by_objective(options, [], SearchMemory(), alpha_d).chosen.id

    assert [winner(a, 1) for a in (0.0001, 0.001, 0.01)] == [2, 2, 1]
    assert [winner(a, 5000) for a in (0.0001, 0.001, 0.01)] == [2, 2, 2]


@pytest.mark.parametrize(
    ("norm", "nats"),
    [("sum", 500.0), ("per_gaussian", 2.0), ("per_area", 1000), ("per_pixel", 0.1)],
)
def test_the_gain_is_normalised_by_the_setting_and_never_negative(
    norm: GainNorm, nats: float
) -> None:
    assert normalised_gain(Gain(500.0, 250, 0.5, 5000.0), norm) == pytest.approx(nats)
    assert normalised_gain(Gain(-1.0, 250, 0.5, 5000.0), norm) == 0.0
    assert normalised_gain(Gain(0.0, 0), norm) == 0.0


@pytest.mark.parametrize(("norm", "missing"), [("per_area", "area"), ("per_pixel", "pixels")])
def test_a_gain_whose_divisor_an_older_object_map_does_not_report_is_refused(
    norm: GainNorm, missing: str
) -> None:
    with pytest.raises(InvalidInput, match=f"without its {missing}, which gain_norm={norm} needs"):
        normalised_gain(Gain(500.0, 250), norm)


def test_a_frontier_that_is_chosen_again_stands_once_with_its_last_value_and_place() -> None:
    """Eq. 9 is a mean over a set: counted twice, the first frontier would shift it."""
    memory = SearchMemory({1: FirstSeen(1.0, 1.0, (0.0, 0.0))})
    for xy, value in (((0.0, 0.0), 0.5), ((5.0, 0.0), 0.25), ((0.4, 0.0), 0.2)):
        memory.choose(ChosenFrontier(xy, value))
    assert memory.chosen == [ChosenFrontier((5.0, 0.0), 0.25), ChosenFrontier((0.4, 0.0), 0.2)]
    assert frontier_scale(memory, 0.0) == pytest.approx((1 / 0.25 + 1 / 0.2) / 2)
    memory.choose(ChosenFrontier((1.0, 0.0), 0.3))  # 0.6 m from the nearest
    assert len(memory.chosen) == 3


def test_gains_outlive_a_restart_and_stand_in_the_record_of_a_decision() -> None:
    gain = Gain(12.0, 4, 0.5, 60.0)
    memory = SearchMemory({1: FirstSeen(0.5, 3.0, (0.0, 0.0), gain)})
    memory.note(2, FirstSeen(0.5, 3.0, (1.0, 0.0)))
    assert SearchMemory.of_json(json.loads(json.dumps(memory.as_json()))) == memory
    option = ReceptacleOption(instance(7), 0.6, 3.0, 2.0, gain=gain)
    for rule in (by_objective, receptacles_first):
        stored = rule([option], [], memory, ALPHA_D).memory
        assert as_memory(stored) == memory
        assert {c.id: Gain.of_terms(c.terms) for c in stored if c.kind == "gain"} == {7: gain}


def test_a_decision_lists_every_candidate_with_its_terms_and_says_why() -> None:
    memory = SearchMemory({1: FirstSeen(0.5, 2.0, (0.0, 0.0))}, [ChosenFrontier((0.0, 0.0), 0.5)])
    receptacle = ReceptacleOption(instance(7), 0.6, 1.5, 3.0)
    frontier = FrontierOption(9, (5.0, 5.0), 0.4, 6.0)
    got = by_objective([receptacle], [frontier], memory, ALPHA_D)
    assert got.do is Do.SEARCH_RECEPTACLE
    assert got.candidates[0].terms["total"] == pytest.approx(0.6 * 1.5 - 0.003)
    assert got.candidates[1].terms["total"] == pytest.approx(0.4 * 2.0 - 0.006)
    assert "search the mug" in got.why
    assert got.settings["frontier_scale"] == pytest.approx(2.0)


def test_every_rule_reports_that_nothing_is_left() -> None:
    assert by_objective([], [], SearchMemory(), ALPHA_D).do is Do.NOTHING_LEFT
    assert receptacles_first([], [], SearchMemory(), ALPHA_D).do is Do.NOTHING_LEFT
    for rule in (highest_value, nearest, drawn):
        assert rule([], "place", RNG).do is Do.NOTHING_LEFT


def test_without_the_objective_the_nearest_receptacle_comes_before_a_far_better_frontier() -> None:
    receptacles = [
        ReceptacleOption(instance(1), 0.9, 2.0, 8.0),
        ReceptacleOption(instance(2), 0.3, 0.01, 5.0),
    ]
    frontiers = [FrontierOption(9, (1.0, 0.0), 50.0, 0.5)]
    assert by_objective(receptacles, frontiers, SearchMemory(), ALPHA_D).chosen.id == 9
    got = receptacles_first(receptacles, frontiers, SearchMemory(), ALPHA_D)
    assert (got.do, got.chosen.kind, got.chosen.id) == (Do.SEARCH_RECEPTACLE, "receptacle", 2)
    assert len(got.candidates) == 3
    only_frontiers = receptacles_first([], frontiers, SearchMemory(), ALPHA_D)
    assert (only_frontiers.do, only_frontiers.chosen.id) == (Do.GO_TO_FRONTIER, 9)


# --- frontiers -----------------------------------------------------------------------------------
RNG = np.random.default_rng(0)
FRONTIERS = [
    FrontierOption(1, (5.0, 0.0), 0.3, 5.0),
    FrontierOption(2, (1.0, 0.0), 0.3, 1.0),
    FrontierOption(3, (0.5, 0.0), 0.1, 0.5),
]


def test_the_frontier_of_highest_value_wins_and_in_a_tie_the_nearer_one() -> None:
    assert highest_value(FRONTIERS, "place", RNG).chosen.id == 2


def test_the_heuristic_takes_the_nearest_frontier_whatever_its_value() -> None:
    assert nearest(FRONTIERS, "place", RNG).chosen.id == 3


def test_one_seed_draws_the_same_frontiers_and_every_frontier_is_drawn() -> None:
    def draws(seed: int) -> list[int]:
        rng = np.random.default_rng(seed)
        return [drawn(FRONTIERS, "place", rng).chosen.id for _ in range(40)]

    assert draws(1) == draws(1)
    assert draws(1) != draws(2)
    assert set(draws(1)) == {1, 2, 3}


# --- pick and place ------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("score", "after", "do"),
    [
        (0.50, None, Do.ACT),
        (0.49, 0.70, Do.LOOK),  # the view passes the threshold
        (0.10, 0.16, Do.LOOK),  # not the threshold, but it rises by more than tau_inc
        (0.10, 0.14, Do.SEARCH_ON),
        (0.48, 0.50, Do.LOOK),  # min(tau, Psi + tau_inc) is tau here
        (0.48, 0.49, Do.SEARCH_ON),
        (0.48, None, Do.SEARCH_ON),  # no gaze point is left
    ],
)
def test_scores_decide_between_acting_looking_and_searching_on(
    score: float, after: float | None, do: Do
) -> None:
    option = ViewOption(instance(score=score), score, after, 1.0)
    assert act_or_look([option], 0.5, 0.05, "object", Act.PICK).do is do


def test_an_accepted_object_on_the_start_receptacle_is_preferred() -> None:
    options = [
        ViewOption(instance(1), 0.9, None, 1.0, in_place=False),
        ViewOption(instance(2), 0.6, None, 5.0),
    ]
    assert act_or_look(options, 0.5, 0.05, "object", Act.PICK).chosen.id == 2


@pytest.mark.parametrize(("score", "after"), [(0.9, None), (0.4, 0.9)])
def test_an_object_elsewhere_is_remembered_and_neither_picked_nor_looked_at(
    score: float, after: float | None
) -> None:
    options = [ViewOption(instance(1), score, after, 1.0, in_place=False)]
    got = act_or_look(options, 0.5, 0.05, "object", Act.PICK, anywhere=False)
    assert got.do is Do.SEARCH_ON
    assert "remembered" in got.why
    assert act_or_look(options, 0.5, 0.05, "object", Act.PICK).do in (Do.ACT, Do.LOOK)


# --- gaze points ---------------------------------------------------------------------------------
def room(*boxes: tuple[float, float, float, float, float]) -> GroundMap:
    """Make 5 x 4 m of free ground with boxes x0, y0, x1, y1, top."""
    cell = 0.025
    occupancy = np.zeros((160, 200), np.int8)
    top = np.zeros(occupancy.shape, np.float32)
    for x0, y0, x1, y1, height in boxes:
        at = np.s_[round(y0 / cell) : round(y1 / cell), round(x0 / cell) : round(x1 / cell)]
        occupancy[at], top[at] = 100, height
    return GroundMap(occupancy, top, cell, (0.0, 0.0))


TABLE = (2.0, 1.6, 3.0, 2.4, 0.5)
TABLE_SEEN = instance(center=(2.5, 2.0, 0.45), size=(1.0, 0.8, 0.1))
GAZE = GazeRules((0.6, 0.9), 0.8)


def test_gaze_points_lie_around_a_table_are_free_and_face_it() -> None:
    ground = room(TABLE)
    reached = reach(ground, Pose2(0.6, 0.6, 0.0), MotionRules(0.3, 0.05))
    points = gaze_points(TABLE_SEEN, reached, ROBOT, GAZE)
    assert len(points) >= 5
    assert [p.arrival for p in points] == sorted(p.arrival for p in points)
    for p in points:
        assert np.isfinite(reached.at(np.array([p.pose.xy]))[0])
        assert abs(p.pose.bearing_rad((2.5, 2.0))) < 0.01
        assert 0.2 < p.tilt_rad < 1.2
    angles = sorted(math.atan2(p.pose.y_m - 2.0, p.pose.x_m - 2.5) for p in points)
    assert np.diff([*angles, angles[0] + 2 * math.pi]).max() < math.pi / 2


def test_no_gaze_point_lies_behind_something_high() -> None:
    wall = (1.5, 0.0, 1.6, 4.0, 2.5)
    gap_wall = (1.5, 0.0, 1.6, 3.2, 2.5)
    east = reach(room(TABLE, wall), Pose2(4.4, 2.0, 0.0), MotionRules(0.3, 0.05))
    assert all(p.pose.x_m > 1.6 for p in gaze_points(TABLE_SEEN, east, ROBOT, GAZE))
    west = reach(room(TABLE, gap_wall), Pose2(0.6, 0.6, 0.0), MotionRules(0.3, 0.05))
    for p in gaze_points(TABLE_SEEN, west, ROBOT, GazeRules((0.6, 1.2), 0.5)):
        assert p.pose.x_m > 1.6 or p.pose.y_m > 3.0


# --- standing and placing ------------------------------------------------------------------------
def test_a_stand_is_in_reach_faces_the_object_and_differs_from_failed_stands() -> None:
    reached = reach(room(TABLE), Pose2(0.6, 0.6, 0.0), MotionRules(0.3, 0.05))
    target = (2.3, 1.8, 0.5)
    first = stand_for(target, reached, ROBOT, 0.74)
    assert first is not None
    assert first.distance_m(target[:2]) <= 0.74
    assert abs(first.bearing_rad(target[:2])) < 1e-6
    second = stand_for(target, reached, ROBOT, 0.74, [first.xy])
    assert second is not None
    assert second.distance_m(first.xy) > 0.2
    assert stand_for((2.5, 2.0, 0.5), reached, ROBOT, 0.3) is None


def test_places_are_flat_inside_the_edge_and_in_reach() -> None:
    clutter = (2.1, 1.7, 2.35, 1.95, 0.7)
    reached = reach(room(TABLE, clutter), Pose2(0.6, 0.6, 0.0), MotionRules(0.3, 0.05))
    spots = place_spots(TABLE_SEEN, reached, 0.74, PlaceRules(0.12, 0.045))
    assert spots
    for s in spots:
        x, y, z = s.point_m
        assert z == pytest.approx(0.5)
        assert min(x - 2.0, 3.0 - x, y - 1.6, 2.4 - y) > 0.1
        assert not (2.05 < x < 2.4 and 1.65 < y < 2.0)
        assert s.stand.distance_m((x, y)) <= 0.74


# --- the store -----------------------------------------------------------------------------------
def test_tasks_and_decisions_outlive_the_process(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.put(pb.Task(id="a", state="queued", created_s=2))
    store.put(pb.Task(id="b", state="queued", created_s=1))
    store.put(pb.Task(id="a", state="running", created_s=2))
    for k in (1, 0):
        store.add(pb.Decision(task_id="a", index=k, why=f"because {k}"))
    store.close()
    again = Store(tmp_path)
    assert [(t.id, t.state) for t in again.tasks()] == [("b", "queued"), ("a", "running")]
    assert [d.why for d in again.decisions("a")] == ["because 0", "because 1"]
    again.close()


def test_an_unusable_state_directory_is_reported(tmp_path: Path) -> None:
    (tmp_path / "tasks.sqlite").mkdir()
    with pytest.raises(Unavailable, match="give another --state-dir"):
        Store(tmp_path)
