"""Specification of an episode: everything that its result depends on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from helios_client.usage_errors import UsageError
from helios_core.agent_presets import AGENT_NAMES
from helios_core.errors import InvalidInput
from helios_core.name_rules import same_name
from helios_core.plugins import AGENTS
from helios_detector.settings import Settings as DetectorSettings
from helios_detector.simulation.frame_noise import load_noise
from helios_sim.manipulation import PickRule, pick_rule_named

from helios_eval.episodes.absent_targets import is_drawn
from helios_eval.episodes.episode_record import Benchmark, Noise, Semantics, Setting, key_of
from helios_eval.episodes.home_presets import default_steps
from helios_eval.episodes.plan_homes import PlanHomes
from helios_eval.episodes.real_detector import RealDetector
from helios_eval.episodes.task_classes import TaskClasses

WALKER = "ground-truth-walker"  # knows ground truth: shows the reachable maximum
# Keys in the settings of a record that are conditions of a run: they have a flag of their own.
MAX_STEPS, SENSOR, SCORER = "max_steps", "sensor", "detector.scorer"
PICK_RULE, ABSENT = "pick_rule", "absent"
DETECTOR, TASK_CLASSES = "detector.detector", "task_classes"
CONDITIONS = (MAX_STEPS, SENSOR, SCORER, PICK_RULE, ABSENT, DETECTOR, TASK_CLASSES)
DEFAULT_PICK_RULE: PickRule = "physical"
DEFAULT_SCORER = "simulated:itc-v1"  # of an evaluation; served detectors have `lexical`
REAL_SCORER = "lexical"  # of an evaluation with a real detector: no simulated error
SIMULATED = "simulated:"  # begins the names of scorers that read the truth instead of the image


@dataclass(frozen=True)
class EpisodeInputs:
    """Content that the settings of an episode name by a digest."""

    detector: RealDetector | None = None  # None: a simulated one
    task_classes: TaskClasses | None = None  # None: tasks ask for every class
    plans: PlanHomes | None = None  # files of the homes; None: homes of a preset


@dataclass(frozen=True)
class EpisodeSpec:
    """Specification of one episode. Same key, same result, on any core of one machine."""

    benchmark: Benchmark
    agent: str
    semantics: Semantics
    preset: str
    seed: int
    noise: Noise | None
    settings: dict[str, Setting] = field(default_factory=dict)  # as in EpisodeRecord
    inputs: EpisodeInputs = field(default_factory=EpisodeInputs)

    @property
    def key(self) -> str:
        return key_of(
            self.benchmark,
            self.agent,
            self.semantics,
            self.preset,
            self.seed,
            self.noise,
            self.settings,
        )

    @property
    def home_file(self) -> str:
        """Name and SHA-256 of the plan file of the home; empty for a home of a preset."""
        plans = self.inputs.plans
        return plans.label_of(self.seed) if plans is not None else ""

    @property
    def max_steps(self) -> int:
        """Number of actions that the episode may take."""
        return int(self.settings.get(MAX_STEPS, default_steps(self.preset, self.benchmark)))

    @property
    def sensor(self) -> str:
        """Name of the error model of images and poses."""
        return str(self.settings.get(SENSOR, "none"))

    @property
    def pick_rule(self) -> PickRule:
        """Rule of the simulator for picks. Raises InvalidInput for an unknown one."""
        return pick_rule_named(pick_rule_of(self.settings))

    @property
    def colored(self) -> bool:
        """True if a part of the stack may read the color image: a real detector, a scorer that
        looks at it, or an agent of another package.
        """
        scorer = scorer_of(self.settings)
        reads_no_pixels = scorer.startswith(SIMULATED) or scorer == REAL_SCORER
        own_agent = self.agent in (*planner_agents(), WALKER)
        return self.semantics == "detector" or not (reads_no_pixels and own_agent)

    @property
    def target_absent(self) -> bool:
        """True if the task asks for an object that is not in the home."""
        return is_drawn(self.seed, absent_share_of(self.settings))


def scorer_of(settings: Mapping[str, Setting]) -> str:
    """Name of the image-text scorer of episodes with these settings, as a record has them."""
    return str(settings.get(SCORER, DetectorSettings.model_fields["scorer"].default))


def pick_rule_of(settings: Mapping[str, Setting]) -> str:
    """Name of the pick rule of episodes with these settings, as a record has them."""
    return str(settings.get(PICK_RULE, DEFAULT_PICK_RULE))


def absent_share_of(settings: Mapping[str, Setting]) -> float:
    """Share of homes with an absent target, 0 to 1, of episodes with these settings."""
    return float(settings.get(ABSENT, 0.0))


def planner_agents() -> tuple[str, ...]:
    """Names of the planner's own agents."""
    return AGENT_NAMES


def known_agents(benchmark: Benchmark) -> tuple[str, ...]:
    """Names of all agents that can play a benchmark."""
    return (*planner_agents(), WALKER) if benchmark == "ovmm" else planner_agents()


def check_agents(agents: list[str], benchmark: Benchmark) -> list[str]:
    """Canonical names of the agents, each once; letter case does not matter.

    Raises UsageError for an unknown agent, and for one of another package that cannot be loaded.
    """
    known, offered = known_agents(benchmark), AGENTS.entry_names()
    out = [same_name(agent, (*known, *offered)) or agent for agent in agents]
    for agent in out:
        if agent in known:
            continue
        if ":" not in agent and agent not in offered:
            raise UsageError(
                f"no agent of {benchmark} is called {agent!r}; wanted some of {', '.join(known)}, "
                "or package:agent of your own"
            )
        from helios_planner.agents import agent_named

        try:
            agent_named(agent)
        except InvalidInput as error:
            raise UsageError(error.message) from error
    return list(dict.fromkeys(out))


def noise_of(table: str, level: float, correlation: float | None) -> Noise:
    """Noise as the record stores it. Raises InvalidInput for an unknown table."""
    loaded = load_noise(table).scaled(level, correlation)
    return Noise(table=table, digest=loaded.digest, level=level, correlation=correlation)
