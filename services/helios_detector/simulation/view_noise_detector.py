"""Simulated detector with errors correlated by object and view: ground truth and a
`ViewNoiseTable`.

Every draw is keyed by the seed and the *name* of the object, which is the same in every process.
Names repeat across homes ("mug_3"), so each home needs its own seed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from helios_core.name_rules import plain
from helios_core.types import Detection, Frame, SearchContext
from numpy.typing import NDArray

from helios_detector.backend import DetectorBackend, Findings, Seen
from helios_detector.lexical_scorer import household_names
from helios_detector.simulation.false_positives import ghosts
from helios_detector.simulation.ground_truth_detector import Visible, detection, visible
from helios_detector.simulation.mask_errors import Box, Masked, eroded, leaked, partial
from helios_detector.simulation.search import Search
from helios_detector.simulation.view_noise import Views, key_of, keys_of, normal_draws, uniform
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from helios_detector.simulator_truth import Truth, TruthInstance, TruthSource, truth_of
from helios_detector.vocabulary_matching import SearchTarget, open_wanted

PURPOSES: tuple[str, ...] = (
    "miss", "confuse", "confuse as", "score", "twice", "twice score", "mask", "cut", "keep",
)  # fmt: skip
_PURPOSE_KEYS = keys_of(PURPOSES)
_STANDARD = NormalDist()
_ROUNDING = 1e-6  # more than the rounding errors of `uniform` and its inverse
Other = tuple[int, float]  # place of a search class, and the uniform draw of its score
_NAME, _SCORE, _SECOND = (PURPOSES.index(p) for p in ("confuse as", "score", "twice score"))


@dataclass(frozen=True)
class SimulatedResult:
    """The simulated result for one visible object."""

    thing: Visible
    names: tuple[tuple[str, float], ...]  # reported classes and scores; empty if missed
    draws: Mapping[str, float]  # purpose -> uniform draw


class ViewNoiseDetector(DetectorBackend):
    """Detector with misses, class confusions, second names, false positives and mask errors;
    errors persist for the same view."""

    def __init__(self, source: TruthSource, table: ViewNoiseTable, seed: int = 0) -> None:
        self._source, self._table, self._seed = source, table, seed
        self.name = f"simulated:{table.name}@{table.digest}"
        self._last: tuple[SearchContext, Search] | None = None

    def vocabulary(self) -> tuple[str, ...]:
        """Household names and the table's classes only: false positives would show any other name
        too, such as unicorn."""
        return tuple(sorted(household_names() | self._table.rows.keys()))

    def refused(self, context: SearchContext) -> Mapping[str, str]:
        return {}

    def warm_up(self) -> None:
        self._source.check()

    def close(self) -> None:
        """No resources to free."""

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        truth = truth_of(frame, self._source)
        frame = truth.in_world(frame)
        search = self._search(context)
        shape = frame.depth_m.shape
        detections: list[Detection] = []
        seen: dict[str, Seen] = {}

        def see(name: str, score: float) -> None:
            enough = score >= self._table.file.score.seen_above
            if enough and (name not in seen or seen[name].score < score):
                seen[name] = Seen(name, score)

        for verdict in self._verdicts(frame, truth, search):
            masked = None
            for name, score in verdict.names:
                see(name, score)
                matching = (search.wanted[k] for k in search.matching(plain(name)))
                takers = [w for w in matching if score >= w.threshold]
                if takers:
                    masked = masked or self._masked(verdict, frame, truth)
                    detections += [detection(w.name, score, *masked, shape) for w in takers]
        for g in ghosts(frame, truth, search, self._table, self._key):
            see(g.want.name, g.score)
            detections.append(detection(g.want.name, g.score, g.box_xyxy, g.crop, shape))
        return Findings(tuple(detections), tuple(seen.values()))

    def verdicts(
        self, frame: Frame, truth: Truth, wanted: tuple[SearchTarget, ...]
    ) -> list[SimulatedResult]:
        """Results for every visible object, in the search context or not."""
        return self._verdicts(truth.in_world(frame), truth, Search(wanted, self._table.shares))

    def _verdicts(self, frame: Frame, truth: Truth, search: Search) -> list[SimulatedResult]:
        things = list(visible(truth))
        return verdicts(
            things,
            self._table,
            [self._key(t.instance) for t in things],
            frame.T_world_cam[:3, 3],
            frame.stamp_ns,
            search,
        )

    def _search(self, context: SearchContext) -> Search:
        """Search classes of a context; those of the last one are remembered."""
        last, search = self._last or (None, None)
        if search is None or last is not context:
            search = Search(open_wanted(context), self._table.shares)
            self._last = context, search
        return search

    def _key(self, instance: TruthInstance) -> int:
        return key_of(f"{self._seed}/{self._table.name}/{instance.key}")

    def _masked(self, verdict: SimulatedResult, frame: Frame, truth: Truth) -> Masked:
        """The object's box and mask as reported."""
        table, m, u = self._table, self._table.file.mask, verdict.draws
        box, crop = verdict.thing.box_xyxy, verdict.thing.crop
        box, crop = eroded(box, crop, round(m.erode_px * table.level))
        cut = table.rate(m.partial)
        if u["mask"] < cut:
            low, high = m.partial_keeps
            return partial(box, crop, low + u["keep"] * (high - low), int(4 * u["cut"]) % 4)
        if u["mask"] < cut + table.rate(m.leak):
            by_px = min(m.leak_most_px, 1 + round(m.leak_share * verdict.thing.pixels**0.5))
            return leaked(
                box, crop, by_px, lambda box: _support(truth, box), frame.depth_m, m.leak_depth_m
            )
        return box, crop


def verdicts(
    things: list[Visible],
    table: ViewNoiseTable,
    keys: list[int],
    eye_m: NDArray[np.float64],
    stamp_ns: int,
    search: Search | None = None,
) -> list[SimulatedResult]:
    """Results for each object (with its key) seen from the camera position `eye_m` [3], world."""
    if not things:
        return []
    centers_m = np.array([t.instance.center_seen_from(eye_m) for t in things], float)
    pixels = np.array([t.pixels for t in things])
    views, distance_m = table.views(np.array(keys, np.uint64), eye_m, centers_m, pixels)
    z = normal_draws(views, _PURPOSE_KEYS, table.shares, stamp_ns)
    if table.name_shares != table.shares:
        at = slice(_NAME, _NAME + 1)
        z[:, at] = normal_draws(views, _PURPOSE_KEYS[at], table.name_shares, stamp_ns)
    together = table.file.score.together
    if together:
        z[:, _SECOND] = joined(z[:, _SECOND], z[:, _SCORE], together)
    draws = uniform(z)
    classes = [plain(t.instance.class_name) for t in things]
    missed = draws[:, 0] < table.miss(classes, pixels, distance_m)
    others = [[] for _ in things]
    if search is not None and search.wanted:
        others = _others(views, table, search, z[:, _SCORE], stamp_ns)
    out = []
    for k, thing in enumerate(things):
        u = dict(zip(PURPOSES, draws[k].tolist(), strict=True))
        names = () if missed[k] else named(thing.instance.class_name, thing.pixels, table, u)
        if names and search is not None:
            names += also_named(thing, names, table, search, others[k])
        out.append(SimulatedResult(thing, names, u))
    return out


def _others(
    views: Views,
    table: ViewNoiseTable,
    search: Search,
    score_z: NDArray[np.float64],
    stamp_ns: int,
) -> list[list[Other]]:
    """Search classes as which each object may also be reported.

    score_z: [n] draws of the scores of the objects' first names.
    """
    out: list[list[Other]] = [[] for _ in range(len(views))]
    rate = table.anything()
    limit = _STANDARD.inv_cdf(rate) + _ROUNDING if 0 < rate < 1 else (-math.inf, math.inf)[rate > 0]
    limits = np.full((len(views), len(search.wanted)), limit)
    rows, columns, z = search.other.below(views, limits, stamp_ns)
    below = uniform(z) < rate
    rows, columns = rows[below], columns[below]
    if not len(rows):
        return out
    z = normal_draws(views.part(rows), search.other_keys[columns], table.shares, stamp_ns)[:, 0]
    if together := table.file.score.together:
        z = joined(z, score_z[rows], together)
    for row, column, u in zip(rows.tolist(), columns.tolist(), uniform(z).tolist(), strict=True):
        out[row].append((column, u))
    return out


def joined(
    z: NDArray[np.float64], other: NDArray[np.float64], correlation: float
) -> NDArray[np.float64]:
    """Standard normal numbers z [...] with a correlation to `other`, from independent ones."""
    return correlation * other + math.sqrt(1 - correlation * correlation) * z


def named(
    class_name: str, pixels: int, table: ViewNoiseTable, u: Mapping[str, float]
) -> tuple[tuple[str, float], ...]:
    """Reported classes and scores, one or two, of an object that is not missed."""
    true = plain(class_name)
    row = table.rows.get(true)
    if row is None:
        return ((class_name, table.score("true", u["score"], pixels)),)
    other = row.pick(u["confuse as"])
    if u["confuse"] < table.confuse(true):
        first, second = (other, table.score("confused", u["score"], pixels)), class_name
    else:
        first, second = (class_name, table.score("true", u["score"], pixels)), other
    if u["twice"] >= table.second(true):
        return (first,)
    return first, (second, table.score("confused", u["twice score"], pixels))


def also_named(
    thing: Visible,
    names: tuple[tuple[str, float], ...],
    table: ViewNoiseTable,
    search: Search,
    others: Sequence[Other],
) -> tuple[tuple[str, float], ...]:
    """Extra search classes reported for the object without a confusion entry, with scores.

    others: classes that the draws select, ascending.
    """
    known = {plain(name) for name, _ in names} | {plain(thing.instance.class_name)}
    same = {k for name in known for k in search.matching(name)}
    return tuple(
        (search.wanted[k].name, table.score("confused", u, thing.pixels))
        for k, u in others
        if search.wanted[k].is_object == thing.instance.graspable and k not in same
    )


def _support(truth: Truth, box_xyxy: Box) -> NDArray[np.bool_]:
    """Mask of the pixels within a box that no graspable object covers."""
    x0, y0, x1, y1 = box_xyxy
    ids = truth.ids[y0:y1, x0:x1]
    graspable = np.zeros(int(max(ids.max(), *truth.instances, 0)) + 1, bool)
    graspable[[id for id, i in truth.instances.items() if i.graspable]] = True
    return ~graspable[ids]
