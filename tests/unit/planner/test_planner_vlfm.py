"""The VLFM agents: their belief, their choice of frontier, and the variant that stops as HELIOS."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pytest
from helios_core.agent_presets import AgentName
from helios_core.types import ObjectInstance
from helios_planner.agents import AGENTS
from helios_planner.decisions.acceptance import visit_first
from helios_planner.decisions.counterfactual import recompute
from helios_planner.decisions.decision import Decision, DecisionRule, Do, FrontierOption
from helios_planner.decisions.global_search import ChosenFrontier, kept
from helios_planner.instruction.parser import parse
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.robot.detections import Sighting, lies_at_side, sighting_of
from helios_planner.robot.interface import Frontier
from helios_planner.search.baselines import StopSearch, UnfilteredBelief, VlfmBelief
from helios_planner.search.frontier_exploration import TargetPursuit
from helios_planner.settings import Settings
from helios_planner.task import Phase, TaskFailed
from helios_planner.tasks.mission import Mission
from planner_flat import coffee_table, counter, flat, mug
from planner_things import Box, Thing
from planner_world import FakeWorld

FIND = "find the mug"


# --- at the side of an image ---------------------------------------------------------------------
@pytest.mark.parametrize(
    ("left", "right", "aside"),
    [
        (0, 100, True), (32, 213, True), (33, 213, False), (0, 214, False), (200, 400, False),
        (426, 608, True), (426, 607, False), (425, 640, False), (600, 640, True), (0, 640, False),
    ],
)  # fmt: skip
def test_a_box_in_an_outer_third_and_at_the_edge_is_at_the_side(
    left: int, right: int, aside: bool
) -> None:
    assert lies_at_side(left, right, 640) is aside


# --- belief --------------------------------------------------------------------------------------
def mug_sighting(
    x: float, away_m: float = 2.0, at_side: bool = False, confidence: float = 0.5, y: float = 1.0
) -> Sighting:
    points = np.array([x, y, 0.5]) + 0.02 * np.eye(3)
    return sighting_of("mug", confidence, points, np.array([x - away_m, y, 0.5]), at_side)


class SightingRobot:
    """A robot at (1, 1) that looks along x and receives sightings one by one."""

    def __init__(self, belief: type[VlfmBelief] = VlfmBelief) -> None:
        self.world = flat(start=Pose2(1.0, 1.0, 0.0))
        self.reported: list[Sighting] = []
        self.world.sightings = lambda: list(self.reported)
        self.belief = belief(self.world, Settings())

    def report(self, *sightings: Sighting) -> list[float]:
        """Add sightings; return the x of all mugs in the belief."""
        self.reported += sightings
        return [round(float(t.center_m[0]), 1) for t in self.belief.known("mug")]


def test_faint_detections_and_those_from_too_near_are_ignored() -> None:
    assert (
        SightingRobot().report(mug_sighting(3.0, confidence=0.39), mug_sighting(4.0, away_m=0.95))
        == []
    )
    assert SightingRobot().report(
        mug_sighting(3.0, confidence=0.41), mug_sighting(4.0, away_m=1.05)
    ) == [3.0, 4.0]


def test_a_detection_at_the_side_or_far_away_is_tentative_until_seen_from_near() -> None:
    eyes = SightingRobot()
    assert eyes.report(mug_sighting(5.0, 3.0, at_side=True), mug_sighting(8.0, 4.9)) == [5.0, 8.0]
    first, _ = eyes.belief.known("mug")
    assert eyes.belief.still_supports(first)
    assert first.score == 0.0  # too low for a find
    eyes.world._pose = Pose2(3.0, 1.0, 0.0)  # 2 m before the first
    assert eyes.report() == [8.0]
    assert not eyes.belief.still_supports(first)
    assert eyes.belief.from_near(first, "mug", 0.3) is None


def test_a_tentative_detection_stays_while_the_robot_looks_elsewhere() -> None:
    eyes = SightingRobot()
    eyes.report(mug_sighting(5.0, 3.0, at_side=True))
    eyes.world._pose = Pose2(3.0, 1.0, 2.0)
    assert eyes.report() == [5.0]


def test_a_near_detection_at_the_side_is_ignored() -> None:
    assert SightingRobot().report(mug_sighting(3.0, 2.0, at_side=True)) == []


def test_a_good_detection_stays_and_outranks_tentative_ones() -> None:
    eyes = SightingRobot()
    tentative, well = mug_sighting(5.0, 3.0, at_side=True), mug_sighting(5.1, 2.0)
    assert eyes.report(tentative) == [5.0]
    assert eyes.report(well) == [5.1]
    eyes.report(mug_sighting(5.0, 3.0, at_side=True), mug_sighting(8.0, 4.9))
    eyes.world._pose = Pose2(3.0, 1.0, 0.0)
    assert eyes.report() == [5.1]


def test_the_unfiltered_belief_accepts_detections_at_the_side_and_doubts_only_far_ones() -> None:
    eyes = SightingRobot(UnfilteredBelief)
    assert eyes.report(mug_sighting(3.0, 2.0, at_side=True)) == [3.0]
    assert eyes.report(mug_sighting(8.0, 4.9)) == [3.0]


def test_tentative_detections_survive_a_restart_of_the_planner() -> None:
    eyes, later = SightingRobot(), SightingRobot()
    eyes.report(mug_sighting(5.0, 3.0, at_side=True))
    later.belief.restore(eyes.belief.checkpoint())
    assert later.report() == [5.0]
    later.world._pose = Pose2(3.0, 1.0, 0.0)
    assert later.report() == []


def test_a_thing_seen_after_a_restart_never_gets_the_id_of_one_that_was_taken() -> None:
    eyes, later = SightingRobot(), SightingRobot()
    eyes.report(mug_sighting(5.1, 2.0), mug_sighting(8.0, 2.0))
    first, newest = eyes.belief.known("mug")
    eyes.belief.taken(newest)
    later.belief.restore(json.loads(json.dumps(eyes.belief.checkpoint())))
    later.report(mug_sighting(2.0, 2.0))
    ids = {t.id for t in later.belief.known("mug")}
    assert first.id in ids
    assert newest.id not in ids


# --- which frontier ------------------------------------------------------------------------------
def options(*values: float) -> list[FrontierOption]:
    return [FrontierOption(k, (float(k), 0.0), v, 1.0) for k, v in enumerate(values)]


@pytest.mark.parametrize(
    ("last", "chosen"),
    [
        (None, 2),
        (ChosenFrontier((1.0, 0.0), 0.30), 1),
        (ChosenFrontier((1.4, 0.0), 0.30), 1),
        (ChosenFrontier((1.0, 0.0), 0.309), 1),
        (ChosenFrontier((1.0, 0.0), 0.311), 2),
        (ChosenFrontier((-0.6, 0.0), 0.1), 2),
    ],
)
def test_the_last_frontier_is_kept_while_its_value_has_not_fallen(
    last: ChosenFrontier | None, chosen: int
) -> None:
    assert kept(options(0.1, 0.30, 0.35), "pick", last).chosen.id == chosen


def test_without_a_frontier_nothing_is_left() -> None:
    assert kept([], "pick", ChosenFrontier((0.0, 0.0), 0.5)).do is Do.NOTHING_LEFT


def pursuit_with_values(values: list[float]) -> tuple[FakeWorld, TargetPursuit]:
    """Make a robot on its way to a frontier 4 m ahead, whose value changes after each look."""
    world = flat(start=Pose2(0.6, 1.2, 0.0))
    mission = Mission(world, parse(FIND), Settings(agent="vlfm"))
    mission.tools.base.look_around()
    search = mission.agent.seek_object(mission.tools, "mug", None)
    messages = iter(values)
    worth = [next(messages)]
    look = world.look

    def looking() -> None:
        look()
        worth[0] = next(messages, worth[0])

    world.look = looking
    world.frontiers = lambda: [Frontier(1, (4.0, 1.2), 1.0, {"pick": worth[0]})]
    return world, TargetPursuit(search, "pick")


def test_a_frontier_whose_value_falls_on_the_way_is_abandoned() -> None:
    world, pursuit = pursuit_with_values([0.5, 0.495, 0.48])
    before = world.steps
    assert pursuit.step(lambda: False)
    assert world.steps - before <= 5
    assert world.pose().x_m < 3.5


def test_a_frontier_that_keeps_its_value_is_visited() -> None:
    world, pursuit = pursuit_with_values([0.5])
    assert pursuit.step(lambda: False)
    assert world.pose().distance_m((4.0, 1.2)) < 1.5
    assert pursuit.checkpoint() == [4.0, 1.2, 0.5]


def test_a_restored_search_keeps_its_frontier() -> None:
    world = flat()
    mission = Mission(world, parse(FIND), Settings(agent="vlfm"))
    for agent in ("vlfm", "vlfm-helios-stop"):
        first = AGENTS[agent].seek_object(mission.tools, "mug", None)
        checkpoint = first.checkpoint() | {"explorer": [1.0, 2.0, 0.3]}
        first.restore(checkpoint)
        assert first.checkpoint() == checkpoint


# --- finding -------------------------------------------------------------------------------------
@pytest.mark.parametrize("agent", ["vlfm", "vlfm-unfiltered", "vlfm-helios-stop"])
def test_a_mug_that_is_always_detected_is_found(agent: AgentName) -> None:
    world = flat([coffee_table(), counter(), mug()])
    Mission(world, parse(FIND), Settings(agent=agent)).run()
    assert world.pose().distance_m((7.2, 5.35)) < 1.0
    assert world.contacts == 0


@pytest.mark.parametrize("agent", ["vlfm", "vlfm-unfiltered"])
def test_an_unreachable_detection_is_abandoned_for_a_reachable_one(
    agent: AgentName, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The unreachable mug is seen through a window, too far away to be seen well."""
    world = flat([coffee_table(), counter(), mug()])
    real, beyond = world.sightings, mug_sighting(12.0, away_m=4.9)
    monkeypatch.setattr(world, "sightings", lambda: [*real(), beyond])
    messages: list[str] = []

    def tell(_phase: Phase, _seeking: str, message: str) -> None:
        messages.append(message)
        assert len(messages) < 1000, f"it says for ever: {message}"

    monkeypatch.setattr(world, "on_phase", tell)
    Mission(world, parse(FIND), Settings(agent=agent)).run()
    assert world.pose().distance_m((7.2, 5.35)) < 1.0
    assert world.contacts == 0


def rarely_detected_mug() -> Thing:
    """Make a false mug that is detected as a mug in every fourth view."""
    return mug(4, 2.9, 6.5, 0.95, rate=0.25)


def test_vlfm_stops_at_a_false_mug_and_the_helios_stop_decision_does_not() -> None:
    def found_at(agent: AgentName) -> float:
        world = flat([counter(), mug(), rarely_detected_mug()], Pose2(1.5, 4.0, 1.2))
        Mission(world, parse(FIND), Settings(agent=agent)).run()
        return world.pose().x_m

    assert found_at("vlfm") < 4.4
    assert found_at("vlfm-helios-stop") > 4.5


def test_the_helios_stop_decision_never_stops_below_its_threshold() -> None:
    world = flat([counter(), rarely_detected_mug()], Pose2(1.5, 4.0, 1.2))
    with pytest.raises(TaskFailed):
        Mission(world, parse(FIND), Settings(agent="vlfm-helios-stop", rounds=1)).run()
    assert not any(d.do is Do.ACT for d in world.decisions)


def found_by_stop_search(world: FakeWorld, rounds: int = 1) -> str:
    settings = Settings(agent="vlfm-helios-stop", rounds=rounds)
    return Mission(world, parse(FIND), settings).run()


def test_the_stop_search_visits_every_gaze_point_before_it_judges_the_score(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From the start the mug's score is above tau_g. The paper's flow would stop at once."""
    world = flat([counter(), mug(3, 2.9, 6.5, 0.95)], Pose2(1.5, 4.0, 1.2))
    left: list[int] = []
    judge = StopSearch.judge

    def judging(search: StopSearch, things: Sequence[ObjectInstance]) -> Decision:
        left.extend(len(search.looking.remaining_gaze_points(o)) for o in things)
        return judge(search, things)

    monkeypatch.setattr(StopSearch, "judge", judging)
    found_by_stop_search(world)
    stop = Settings().tau_g
    first, *_, last = [d for d in world.decisions if d.candidates[0].kind == "object"]
    assert (first.rule, first.do) == (DecisionRule.GAZE_POINTS_FIRST, Do.LOOK)
    assert first.chosen.terms["score"] >= stop
    assert (last.rule, last.do) == (DecisionRule.STOP, Do.ACT)
    assert left == [0]
    paper = flat([counter(), mug(3, 2.9, 6.5, 0.95)], Pose2(1.5, 4.0, 1.2))
    Mission(paper, parse(FIND), Settings(agent="helios-paper")).run()
    assert paper.decisions[0].do is Do.ACT
    assert paper.steps < world.steps


def test_a_candidate_below_the_threshold_is_visited_once_in_each_round_and_left() -> None:
    for rounds in (1, 2):
        doubtful = mug(4, 2.9, 6.5, 0.95, rate=0.5)
        world = flat([counter(), doubtful], Pose2(1.5, 4.0, 1.2))
        with pytest.raises(TaskFailed, match="no mug was found"):
            found_by_stop_search(world, rounds=rounds)
        visits = [d for d in world.decisions if d.rule == DecisionRule.GAZE_POINTS_FIRST]
        assert len(visits) == rounds
        assert not any(d.do is Do.ACT for d in world.decisions)
        assert not any(d.rule == DecisionRule.BEST_VIEW for d in world.decisions)


def stop_search(world: FakeWorld) -> StopSearch:
    """Return a search after a look around, in which the robot knows a mug."""
    mission = Mission(world, parse(FIND), Settings(agent="vlfm-helios-stop"))
    mission.tools.base.look_around()
    search = mission.agent.seek_object(mission.tools, "mug", None)
    assert isinstance(search, StopSearch)
    return search


def test_visited_candidates_survive_a_restart_of_the_planner() -> None:
    world = flat([counter(), mug(3, 2.9, 6.5, 0.95)], Pose2(1.5, 4.0, 1.2))
    before = stop_search(world)
    assert before.decide().do is Do.LOOK
    assert before.decide_and_publish().do is Do.ACT
    after = stop_search(world)
    after.restore(json.loads(json.dumps(before.checkpoint())))
    assert after.decide().do is Do.ACT
    old = before.checkpoint()
    del old["visited"]
    after = stop_search(world)
    after.restore(old)  # of an earlier build: the candidate is visited again
    assert after.decide().do is Do.LOOK


def test_a_visit_ends_when_the_object_is_no_longer_a_candidate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = flat([counter(), mug(3, 2.9, 6.5, 0.95)], Pose2(1.5, 4.0, 1.2))
    search = stop_search(world)
    objects, steps = world.objects, world.steps + 3
    monkeypatch.setattr(world, "objects", lambda n: objects(n) if world.steps < steps else [])
    assert search.decide_and_publish().do is Do.SEARCH_ON
    assert world.steps - steps <= 1
    assert not search.visited.points


def test_a_mug_without_a_gaze_point_is_found_from_as_near_as_possible() -> None:
    """A mug in the middle of a wide table: no gaze point of the contours is free. One view in each
    round is taken instead; after that of the second round the score is high enough."""
    wide = Box(1.0, 3.9, 4.2, 6.9, 0.5)
    world = flat([mug(4, x=2.6, y=5.4, z=0.55)], Pose2(1.5, 1.5, 1.2), [wide])
    assert "found the mug at (2.60, 5.40" in found_by_stop_search(world, rounds=2)


def test_whether_a_visit_would_change_with_another_tau_g_is_not_certain() -> None:
    thing = flat([counter(), mug(3, 2.9, 6.5, 0.95)], Pose2(1.5, 4.0, 1.2)).objects("mug")
    visit = visit_first(thing, [2.5])
    assert "2.5 m away" in visit.why
    assert recompute(visit, {"alpha_d": 0.1}).certain
    assert not recompute(visit, {"tau_g": 0.1}).certain


# --- 50-50 ---------------------------------------------------------------------------------------
@pytest.mark.parametrize(("agent", "share"), [("helios-paper", None), ("helios-5050", 0.5)])
def test_the_5050_agent_applies_its_share_to_the_joint_gain_and_not_to_single_views(
    agent: AgentName, share: float | None
) -> None:
    """The share counts in the joint gain (eq. 12); the score after one more view (eq. 11) stays."""
    world = flat([counter()], Pose2(2.2, 5.0, 1.57))
    tools = Mission(world, parse(FIND), Settings(agent=agent)).tools
    tools.base.look_around()
    (thing,) = world.objects("counter")
    assert tools.looking.information_gain(thing, "counter") is not None
    assert tools.looking.best_view(thing, "counter") is not None
    assert world.shares == {(True, share), (False, None)}
