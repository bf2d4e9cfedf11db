"""Sessions of the study: a first visit that makes the saved map, and later ones that start
elsewhere.

The task of a home is "Find the <object>". A session does that task, and may then explore the home.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from helios_core import proto as pb
from helios_core.geometry import Matrix
from helios_core.map_snapshot import MapView
from helios_core.topics import LOAD_MAP2D, LOAD_OBJECTS, SAVE_MAP2D, SAVE_OBJECTS
from helios_core.types import ObjectInstance
from helios_sim.episode_tracker import episode_of
from helios_sim.home import Episode, Home
from helios_sim.sensor_noise import SENSORS
from helios_sim.simulation_thread import WorldThread
from helios_sim.start_poses import with_random_start
from helios_sim.world import World

from helios_eval.episodes import home_presets
from helios_eval.episodes.episode_player import LONGEST_S
from helios_eval.episodes.episode_spec import DEFAULT_SCORER, SCORER, noise_of
from helios_eval.episodes.in_process_stack import CALL_S, InProcessStack

VISIT_STEPS = 1000  # most actions of a first visit
LATER_STEPS = 40  # actions of a later session until it must be relocalised
AGENT = "helios"
_ORIGIN = (0.0, 0.0, 0.0)  # pose that a robot of unknown origin reports at its start

OnStep = Callable[[InProcessStack, WorldThread], None]


@dataclass(frozen=True)
class Place:
    """Home of a session, its sensors, and where the robot starts."""

    preset: str
    seed: int
    sensor: str
    random_start: int | None = None  # seed of the start pose; None: the start of the home

    @property
    def home(self) -> Home:
        home = self._own
        return home if self.random_start is None else with_random_start(home, self.random_start)

    @property
    def sought(self) -> str:
        """Class of the object to find."""
        return episode_of(self._own, self.seed).object_class

    @property
    def _own(self) -> Home:
        return home_presets.home_of(self.preset, self.seed)


@dataclass(frozen=True)
class SavedMap:
    """Both maps as `helios map save` writes them."""

    map2d: bytes
    objects: bytes


@dataclass(frozen=True)
class Moment:
    """Maps of a session after an action, and the truth about its frame."""

    step: int
    view: MapView
    objects: tuple[ObjectInstance, ...]
    T_estimated_true: Matrix


@dataclass(frozen=True)
class Session:
    """Result of a session."""

    found_step: int  # actions until the task ended in front of the object; 0: it did not
    steps: int
    saved: SavedMap


def play(
    place: Place,
    most_steps: int,
    on_step: OnStep = lambda *_: None,
    stored: SavedMap | None = None,
    explores: bool = True,
) -> Session:
    """Play a session of at most `most_steps` actions. Raises HeliosError.

    on_step: called after each action. stored: map to load at the start, as `helios map load` does.
    explores: go on to explore the home after the task.
    """
    with _running(place, on_step) as (thread, stack):
        if stored is not None:
            _load(stack, stored)
        task = stack.run(f"Find the {place.sought}", most_steps, LONGEST_S)
        steps, arrived = thread.run(lambda world: (world.progress.steps, world.arrived()))
        found = steps if task.state == "succeeded" and arrived else 0
        if explores and steps < most_steps - 1:
            stack.run("explore the home", most_steps - steps, LONGEST_S)
            steps = thread.run(lambda world: world.progress.steps)
        return Session(found, steps, saved_map(stack))


def moment_of(stack: InProcessStack, thread: WorldThread) -> Moment:
    """Present maps of a session."""
    step, T = thread.run(lambda world: (world.progress.steps, world.T_estimated_true))
    return Moment(step, stack.map(), tuple(stack.objects()), T)


def saved_map(stack: InProcessStack) -> SavedMap:
    """Both maps of a running session."""
    bus = stack.bus()
    [map2d] = bus.call(SAVE_MAP2D, pb.SaveMap2DRequest(), CALL_S).files
    return SavedMap(map2d.data, bus.call(SAVE_OBJECTS, pb.Empty(), CALL_S).data)


def _load(stack: InProcessStack, stored: SavedMap) -> None:
    bus = stack.bus()
    bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=stored.objects), CALL_S)
    file = pb.Map2DFile(name="map2d.map", data=stored.map2d)
    bus.call(LOAD_MAP2D, pb.LoadMap2DRequest(files=[file]), CALL_S)


@contextmanager
def _running(place: Place, on_step: OnStep) -> Iterator[tuple[WorldThread, InProcessStack]]:
    """World and stack of a session, for the duration of the block."""
    home = place.home
    episode = Episode(place.sought, "", "", f"Find the {place.sought}")
    origin = None if place.random_start is None else _ORIGIN
    thread = WorldThread(
        lambda: World(
            home, episode, sensor=SENSORS[place.sensor], colored=False, reported_start=origin
        )
    )
    noise = noise_of(home_presets.noise_of(place.preset), 1.0, None)
    stack: InProcessStack | None = None

    def step() -> None:
        if stack is not None:
            stack.settle()
            on_step(stack, thread)

    try:
        stack = InProcessStack(thread, AGENT, noise, place.seed, {SCORER: DEFAULT_SCORER}, step)
        with stack:
            yield thread, stack
    finally:
        thread.close()
