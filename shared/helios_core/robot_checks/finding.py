"""Result of one check of a robot's set-up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Verdict = Literal["ok", "wrong", "not measured"]

SIGNIFICANT = 3.0  # standard errors that a value must have to be wrong


@dataclass(frozen=True)
class Limit:
    """Name of a check, its unit, and the largest size that is still right."""

    name: str
    unit: str
    limit: float
    floor: float  # least standard error, for what the robot's model leaves out


PITCH = Limit("pitch", "deg", 0.6, 0.04)
ROLL = Limit("roll", "deg", 0.6, 0.04)
HEIGHT = Limit("height", "m", 0.02, 0.001)
DEPTH_SCALE = Limit("depth scale", "%", 0.6, 0.05)
REGISTRATION = Limit("depth-colour registration", "px", 2.0, 0.2)
TIME_OFFSET = Limit("time offset", "s", 0.025, 0.002)
HEADING = Limit("heading drift", "deg per turn", 3.0, 0.2)
DISTANCE = Limit("distance drift", "%", 3.0, 0.2)
INTRINSICS = Limit("intrinsics", "%", 15.0, 0.0)
CHECKS = (
    PITCH, ROLL, HEIGHT, DEPTH_SCALE, REGISTRATION, TIME_OFFSET, HEADING, DISTANCE, INTRINSICS,
)  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """Result of one check. Value, error and limit have the unit `unit`."""

    name: str
    verdict: Verdict
    value: float
    error: float  # standard error of the value
    limit: float
    unit: str
    words: str  # one sentence: what is wrong and by how much, or why nothing was measured


@dataclass(frozen=True)
class Estimate:
    """Value with its standard error, from n measurements."""

    value: float
    error: float
    n: int


def combined(values: Sequence[float], errors: Sequence[float], floor: float) -> Estimate | None:
    """Weighted mean without outliers, and its standard error, at least `floor`; None: no value."""
    if not len(values):
        return None
    v, e = np.asarray(values, float), np.asarray(errors, float)
    middle = float(np.median(v))
    spread = max(1.48 * float(np.median(np.abs(v - middle))), float(np.median(e)))
    kept = np.abs(v - middle) <= 3.0 * spread + 1e-12
    weight = 1.0 / (e[kept] ** 2 + spread**2 + 1e-18)
    mean = float((weight * v[kept]).sum() / weight.sum())
    scatter = float(np.sqrt((weight * (v[kept] - mean) ** 2).sum() / weight.sum()))
    n = int(kept.sum())
    if n > 1:  # a scatter of few values is uncertain itself
        scatter *= (1.0 + 2.0 / (n - 1)) / math.sqrt(n - 1)
    known = float(1.0 / np.sqrt((1.0 / (e[kept] ** 2 + 1e-18)).sum()))
    return Estimate(mean, max(scatter, known, floor), n)


def judged(check: Limit, found: Estimate, more: str, less: str, right: str) -> Finding:
    """Finding of a measured value: wrong beyond the limit, if the value is significant.

    more, less: sentences with `{size}` for a positive and a negative value that is wrong.
    right: the sentence if it is not.
    """
    size = abs(found.value)
    wrong = size > check.limit and size > SIGNIFICANT * found.error
    words = (more if found.value > 0 else less) if wrong else right
    return Finding(
        check.name,
        "wrong" if wrong else "ok",
        found.value,
        found.error,
        check.limit,
        check.unit,
        words.format(size=shown(size, check.unit)),
    )


def not_measured(check: Limit, why: str) -> Finding:
    """Finding without a value. why: what is missing, and what to do."""
    return Finding(check.name, "not measured", 0.0, 0.0, check.limit, check.unit, why)


def shown(size: float, unit: str, error: float = 0.0) -> str:
    """Value with its unit, and with its standard error if that is not 0, for people."""
    factor, digits, name = _SHOWN.get(unit, (1.0, 1, unit))
    if not error:
        return f"{round(size * factor, digits) + 0.0:.{digits}f} {name}"
    digits += 1
    value = round(size * factor, digits) + 0.0  # no minus before 0
    return f"{value:.{digits}f} ± {error * factor:.{digits}f} {name}"


_SHOWN = {"m": (100.0, 1, "cm"), "s": (1000.0, 0, "ms"), "deg per turn": (1.0, 1, "deg a turn")}


def warning(findings: Sequence[Finding]) -> str:
    """One sentence that names everything wrong; empty if nothing is."""
    wrong = [finding.words for finding in findings if finding.verdict == "wrong"]
    return "; ".join(wrong)
