"""Input of the object map during an episode, recorded for other maps."""

from __future__ import annotations

from dataclasses import dataclass

from helios_client.usage_errors import UsageError
from helios_core import proto as pb
from helios_core.codec import context_from_proto, observation_from_proto, state_from_proto
from helios_core.topics import CONTEXT, OBSERVATION, ROBOT_STATE
from helios_core.types import Observation, SearchContext

from helios_eval.episodes import home_presets
from helios_eval.episodes.episode_player import LONGEST_S, running_stack
from helios_eval.episodes.episode_record import Setting
from helios_eval.episodes.episode_spec import EpisodeSpec, noise_of
from helios_eval.episodes.in_process_stack import InProcessStack
from helios_eval.studies.map_growth.simulated_walk import strided


@dataclass(frozen=True)
class Seen:
    """One observation, with its search context and the name of the held object."""

    observation: Observation
    context: SearchContext
    held: str


def by_helios(preset: str, seed: int, settings: dict[str, Setting]) -> EpisodeSpec:
    """Episode of `helios-paper` with the preset's noise.

    Raises InvalidInput for an unknown table.
    """
    noise = noise_of(home_presets.noise_of(preset), 1.0, None)
    return EpisodeSpec("ovmm", "helios-paper", "noisy", preset, seed, noise, settings)


def play(preset: str, seed: int, max_steps: int, stride_px: int) -> list[Seen]:
    """Recording of an episode of the agent `helios-paper` with the preset's noise.

    Frames are reduced to the pixels that a map with that stride uses. Raises HeliosError.
    """
    with running_stack(by_helios(preset, seed, {}), colored=False) as (thread, stack):
        instruction = thread.run(lambda world: world.episode.instruction)
        tape = recorded(stack, instruction, max_steps, stride_px)
    if not tape:
        raise UsageError(f"the episode of seed {seed} showed nothing in {max_steps} steps")
    return tape


def recorded(stack: InProcessStack, instruction: str, max_steps: int, stride_px: int) -> list[Seen]:
    """Run one task; return the input of the stack's object map, on the pixels of a stride."""
    recorder = _Recorder(stride_px)
    bus = stack.bus()
    bus.subscribe(CONTEXT, recorder.on_context)
    bus.subscribe(ROBOT_STATE, recorder.on_state)
    bus.subscribe(OBSERVATION, recorder.on_observation)
    stack.run(instruction, max_steps, LONGEST_S)
    bus.close()
    return recorder.tape


class _Recorder:
    def __init__(self, stride_px: int) -> None:
        self.tape: list[Seen] = []
        self._stride_px = stride_px
        self._context: SearchContext | None = None
        self._held = ""

    def on_context(self, message: pb.SearchContext) -> None:
        self._context = context_from_proto(message)

    def on_state(self, message: pb.RobotState) -> None:
        self._held = state_from_proto(message).held

    def on_observation(self, message: pb.Observation) -> None:
        observation = observation_from_proto(message)
        if self._context is not None and self._context.id == observation.context_id:
            seen = strided(observation, self._stride_px)
            self.tape.append(Seen(seen, self._context, self._held))
