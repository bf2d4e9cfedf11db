"""Arms: the episodes of a folder, grouped by agent and by the conditions of the run."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from helios_eval.episodes import home_presets
from helios_eval.episodes.episode_record import EpisodeRecord, Noise, Setting
from helios_eval.episodes.episode_spec import (
    CONDITIONS,
    DETECTOR,
    MAX_STEPS,
    SENSOR,
    TASK_CLASSES,
    absent_share_of,
    pick_rule_of,
    scorer_of,
)
from helios_eval.report.requested_episodes import Identity

# Order in which agents are shown; others stand between FIRST and LAST, by name.
FIRST = (
    "ground-truth-walker",
    "helios",
    "helios-paper",
    "helios-5050",
    "no-global-objective",
    "nearest-frontier",
    "trusting",
    "homerobot-heuristic",
    "vlfm-helios-stop",
    "vlfm",
    "vlfm-unfiltered",
)
LAST = ("random-frontier",)
# Agents of the paper, and those that show the upper and lower limit; all others are ideas beyond
# the paper.
KNOWN = frozenset((*FIRST, *LAST)) - {"helios"}
REFERENCES = {  # reference agent of a benchmark: the first that was run
    "ovmm": ("helios-paper", "trusting"),
    "objectnav": ("vlfm-helios-stop", "helios-paper", "vlfm"),
}

MOST_NAMED = 2  # settings that an arm's label names


@dataclass(frozen=True)
class Arm:
    """One agent under one condition. `records` are in the order of their seeds."""

    benchmark: str
    agent: str
    semantics: str
    preset: str
    noise: Noise | None
    settings: tuple[tuple[str, Setting], ...]
    records: tuple[EpisodeRecord, ...]
    label: str = ""
    requested_episodes: int = 0  # episodes that commands requested; 0 if unknown

    @property
    def identity(self) -> Identity:
        """Fields that identify an arm."""
        return (self.benchmark, self.agent, self.semantics, self.preset, self.noise, self.settings)

    @property
    def is_complete(self) -> bool:
        """True if all requested episodes were played."""
        return len(self.records) >= self.requested_episodes

    @property
    def condition(self) -> tuple[object, ...]:
        """Conditions without agent and settings: arms of one condition play the same episodes."""
        settings = dict(self.settings)
        return (
            self.benchmark, self.preset, self.semantics, self.noise, self.scorer, self.pick_rule,
            self.absent_share, self.detector, self.task_classes,
            settings.get(SENSOR), settings.get(MAX_STEPS),
        )  # fmt: skip

    @property
    def own_settings(self) -> dict[str, Setting]:
        """Settings of the method, without those of homes and camera, which all agents share."""
        return {k: v for k, v in self.settings if k not in CONDITIONS}

    @property
    def played(self) -> tuple[EpisodeRecord, ...]:
        """Records without the episodes that could not be played."""
        return tuple(r for r in self.records if r.was_played)

    @property
    def scorer(self) -> str:
        """Name of the image-text scorer."""
        return scorer_of(dict(self.settings))

    @property
    def pick_rule(self) -> str:
        """Name of the simulator's rule for picks."""
        return pick_rule_of(dict(self.settings))

    @property
    def detector(self) -> str:
        """Name and digest of the real detector; empty for a simulated one."""
        return str(dict(self.settings).get(DETECTOR, ""))

    @property
    def task_classes(self) -> str:
        """Name and digest of the classes that tasks may ask for; empty: every class."""
        return str(dict(self.settings).get(TASK_CLASSES, ""))

    @property
    def absent_share(self) -> float:
        """Share of homes whose task was to ask for an absent object, 0 to 1."""
        return absent_share_of(dict(self.settings))

    def sort_key(self) -> tuple[object, ...]:
        """Sort key that puts the arm that represents its agent first."""
        level = abs(self.noise.level - 1) if self.noise else 0.0
        drawn = self.noise is not None and self.noise.correlation is not None
        other = has_other_table(self)
        return (len(self.settings), other, level, drawn, -len(self.records), self.preset)

    def noise_key(self) -> tuple[object, ...]:
        """Sort key that puts the noise nearest to the preset's first."""
        return self.sort_key()[1:4]


def has_other_table(arm: Arm) -> bool:
    """True if the noise of an arm is not of its preset's table."""
    return arm.noise is not None and arm.noise.table != home_presets.noise_of(arm.preset)


def arms_of(
    records: Iterable[EpisodeRecord], asked: Mapping[Identity, set[int]] | None = None
) -> list[Arm]:
    """Arms of a folder with distinct labels, in display order.

    asked: requested seeds of each arm, played or not.
    """
    groups: dict[tuple[object, ...], list[EpisodeRecord]] = defaultdict(list)
    for r in records:
        settings = tuple(sorted(r.settings.items()))
        groups[(r.benchmark, r.agent, r.semantics, r.preset, r.noise, settings)].append(r)
    arms = []
    for group in groups.values():
        first = group[0]
        arms.append(
            Arm(
                first.benchmark,
                first.agent,
                first.semantics,
                first.preset,
                first.noise,
                tuple(sorted(first.settings.items())),
                tuple(sorted(group, key=lambda r: r.seed)),
            )
        )
    arms.sort(key=_order)
    counts = {identity: len(seeds) for identity, seeds in (asked or {}).items()}
    short = [_label(arm, arms, MOST_NAMED) for arm in arms]
    labels = [
        label if short.count(label) == 1 else _label(arm, arms, len(arm.settings))
        for arm, label in zip(arms, short, strict=True)
    ]
    return [
        replace(arm, label=label, requested_episodes=counts.get(arm.identity, 0))
        for arm, label in zip(arms, labels, strict=True)
    ]


def _order(arm: Arm) -> tuple[object, ...]:
    rank = FIRST.index(arm.agent) if arm.agent in FIRST else len(FIRST)
    rank += arm.agent in LAST
    return (
        arm.benchmark != "ovmm",
        arm.semantics != "noisy",
        rank,
        arm.agent,
        *arm.sort_key(),
        str(arm.noise),
        str(arm.settings),
    )


def _label(arm: Arm, arms: Sequence[Arm], most: int) -> str:
    """Label: the agent, and the conditions that distinguish it from the other arms.

    At most `most` of its settings are named; the header of a report has all.
    """
    same = [a for a in arms if a.benchmark == arm.benchmark]
    parts = [arm.agent]
    if len({a.preset for a in same}) > 1:
        parts.append(arm.preset)
    if arm.semantics == "ground-truth" and any(a.semantics == "noisy" for a in same):
        parts.append("ground truth")
    if arm.semantics == "detector" and len({a.semantics for a in same}) > 1:
        parts.append("real detector")
    if arm.noise is not None:
        noises = [a.noise for a in same if a.noise is not None]
        if len({(n.table, n.digest) for n in noises}) > 1:
            parts.append(f"{arm.noise.table} {arm.noise.digest[:6]}")
        parts += (
            noise_parts(arm.noise) if len({(n.level, n.correlation) for n in noises}) > 1 else []
        )
    mine = [dict(a.settings) for a in same if a.agent == arm.agent]
    own = [
        f"{_bare(key)}={setting}"
        for key, setting in arm.settings
        if any(other.get(key, _MISSING) != setting for other in mine)
    ]
    more = len(own) - most
    parts += own if more < 2 else [*own[:most], f"{more} more settings"]
    return " · ".join(parts)


_MISSING = object()


def noise_parts(noise: Noise) -> list[str]:
    """Differences from the unscaled noise table, as text."""
    parts = [] if noise.level == 1 else [f"noise ×{noise.level:g}"]
    return parts + ([] if noise.correlation is None else [f"correlation {noise.correlation:g}"])


def plainest_arms(arms: Sequence[Arm], most: int) -> list[Arm]:
    """The `most` plainest arms, in the given order, for a drawing."""
    plain = sorted(arms, key=lambda a: (len(a.settings), *a.noise_key()))[:most]
    return [arm for arm in arms if arm in plain]


def correlation_name(noise: Noise) -> str:
    """Correlation of the detector's errors, as text."""
    return "as in the table" if noise.correlation is None else f"{noise.correlation:g}"


def plain_arm(arms: Sequence[Arm], benchmark: str, agent: str, semantics: str) -> Arm | None:
    """Arm that represents an agent under the main condition of the folder, or None.

    The main condition has the noise nearest to the preset's, then the most episodes, so that all
    rows of a table share it. Of several arms the one with the fewest settings is taken.
    """
    same = [a for a in arms if (a.benchmark, a.semantics) == (benchmark, semantics)]
    if not same:
        return None
    sizes = Counter[tuple[object, ...]]()
    for arm in same:
        sizes[arm.condition] += len(arm.records)
    main = min(same, key=lambda a: (a.noise_key(), -sizes[a.condition])).condition
    found = [a for a in same if a.agent == agent and a.condition == main]
    return min(found, key=Arm.sort_key, default=None)


def comparable(first: Arm, second: Arm) -> bool:
    """True if two arms differ at most in the agent, and in the semantics with their noise."""
    if first.semantics == second.semantics and first.noise != second.noise:
        return False
    moved = replace(first, semantics=second.semantics, noise=second.noise)
    return moved.condition == second.condition and first.own_settings == second.own_settings


def plain_arm_like(arms: Sequence[Arm], main: Arm, agent: str, semantics: str) -> Arm | None:
    """Arm that represents an agent beside `main`, and is comparable with it, or None.

    It is the agent's plain arm, or the plainest that is comparable.
    """
    plain = plain_arm(arms, main.benchmark, agent, semantics)
    if plain is None or comparable(main, plain):
        return plain
    same = [a for a in arms if (a.agent, a.semantics) == (agent, semantics) and comparable(main, a)]
    return min(same, key=Arm.sort_key, default=None)


def swept_arm(arms: Iterable[Arm], base: Arm, key: str, setting: float) -> Arm | None:
    """Arm equal to `base` but for one setting, whichever service has it, or None."""
    want = {k: v for k, v in base.settings if _bare(k) != key}
    for arm in arms:
        if (arm.agent, *arm.condition) != (base.agent, *base.condition):
            continue
        mine = {k: v for k, v in arm.settings if _bare(k) != key}
        changed = [v for k, v in arm.settings if _bare(k) == key]
        if mine == want and changed and float(changed[0]) == setting:
            return arm
    return None


def pairs(arms: Sequence[Arm]) -> list[tuple[Arm, Arm]]:
    """Pairs of arms to compare.

    Within a condition the reference agent, or else that of the plainest arm, is paired with every
    other agent, and the plainest arm of an agent with its others. The plainest arm of a condition
    is paired with a plainer one of the same agent under another condition, of equal settings if
    there is one.
    """
    out: list[tuple[Arm, Arm]] = []
    conditions = list(dict.fromkeys(a.condition for a in arms))
    for condition in conditions:
        here = [a for a in arms if a.condition == condition]
        plain: dict[str, Arm] = {}
        for arm in sorted(here, key=Arm.sort_key):
            plain.setdefault(arm.agent, arm)
        if len(plain) < 2:
            continue
        wanted = REFERENCES[here[0].benchmark]
        name = next((r for r in wanted if r in plain), next(iter(plain)))
        for agent, other in plain.items():
            if agent == name:
                continue
            new = agent not in KNOWN  # first in its pair: above 0 means better
            out.append((other, plain[name]) if new else (plain[name], other))
    for arm in arms:
        base = _base_of(arm, arms)
        if base is not None:
            out.append((arm, base))
    order = {id(a): i for i, a in enumerate(arms)}
    return sorted(out, key=lambda p: (order[id(p[0])], order[id(p[1])]))


def _base_of(arm: Arm, arms: Sequence[Arm]) -> Arm | None:
    """Arm of the same agent that an arm is compared with; None for the agent's plainest arm."""
    ranked = sorted(
        (a for a in arms if (a.benchmark, a.agent) == (arm.benchmark, arm.agent)),
        key=lambda a: (a.semantics != "noisy", a.sort_key()),
    )
    plainest = next(a for a in ranked if a.condition == arm.condition)
    if arm is not plainest:
        return plainest
    plainer = ranked[: next(i for i, a in enumerate(ranked) if a is arm)]
    alike = (a for a in plainer if a.own_settings == arm.own_settings)
    return next(alike, next(iter(plainer), None))


def in_common(first: Arm, second: Arm) -> tuple[list[EpisodeRecord], list[EpisodeRecord]]:
    """Records of both arms for the seeds that both played, by seed.

    Seeds with homes or tasks known to differ are left out. An episode that never began has no home
    hash and no task, and stays, as a failure.
    """
    mine = {r.seed: r for r in first.records}
    theirs = {r.seed: r for r in second.records}
    seeds = [
        s
        for s in sorted(mine.keys() & theirs.keys())
        if len({mine[s].structure_hash, theirs[s].structure_hash} - {""}) < 2
        and mine[s].absent == theirs[s].absent
        and len({_task(mine[s]), _task(theirs[s])} - {_NO_TASK}) < 2
    ]
    return [mine[s] for s in seeds], [theirs[s] for s in seeds]


_NO_TASK = ("", "", "")


def _task(record: EpisodeRecord) -> tuple[str, str, str]:
    return record.object_class, record.start_receptacle_class, record.goal_receptacle_class


def _bare(key: str) -> str:
    return key.rpartition(".")[2]


def most_common(items: Iterable[str]) -> list[str]:
    """Unique items, the most frequent first."""
    return [item for item, _ in Counter(items).most_common()]
