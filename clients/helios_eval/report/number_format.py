"""Conversion of numbers to text."""

from __future__ import annotations

import math

from helios_eval.report.interval_statistics import MIN_DIFFERING_PAIRS, Interval, Mean
from helios_eval.report.record_metrics import METRICS

NOT_RUN = "not run"
NONE = "–"
RULE = (
    f"An interval is drawn only where at least {MIN_DIFFERING_PAIRS} homes differ: with fewer, no "
    "exact two-sided test at 5 % can tell who is ahead."
)


def number(x: float, digits: int) -> str:
    """Number with a true minus sign; "–" for NaN."""
    if math.isnan(x):
        return NONE
    if math.isinf(x):
        return "∞" if x > 0 else "−∞"
    text = f"{x:.{digits}f}"
    return text.replace("-", "−") if float(text) else text.lstrip("-")


def signed(x: float, digits: int) -> str:
    """Number with its sign, also above 0."""
    text = number(x, digits)
    return f"+{text}" if x > 0 and float(text) != 0 else text


def scale(name: str) -> float:
    """Display factor of a metric: 100 if it is shown in percent, else 1."""
    return 100.0 if METRICS[name].share else 1.0


def mean(name: str, m: Mean) -> str:
    """Mean ± standard error, in the metric's unit."""
    digits, k = METRICS[name].digits, scale(name)
    text = number(m.mean * k, digits)
    return text if math.isnan(m.sem) else f"{text} ± {number(m.sem * k, digits)}"


def share(i: Interval, unit: str = "") -> str:
    """Share in percent with its bounds: "25.0 (7.1 to 59.1)"."""
    return f"{100 * i.value:.1f}{unit} ({100 * i.low:.1f} to {100 * i.high:.1f})"


def bounds(low: float, high: float, digits: int, plus: bool = False) -> str:
    """Bounds as "[low, high]"."""
    show = signed if plus else number
    return f"[{show(low, digits)}, {show(high, digits)}]"


def interval(i: Interval, digits: int) -> str:
    """Value and bounds as "value [low, high]"; "–" for NaN."""
    if math.isnan(i.value):
        return NONE
    return f"{number(i.value, digits)} {bounds(i.low, i.high, digits)}"


def p_value(p: float) -> str:
    """P value, never shown as plain zero."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def duration(seconds: float) -> str:
    """Duration such as 1 h 05 min, 3 min 20 s or 12.3 s."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def plural(n: int, what: str) -> str:
    """Count with its noun: 1 episode, 2 episodes."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def ranges(numbers: list[int]) -> str:
    """Sorted numbers as ranges: 0–9, 12, 20–22."""
    parts: list[list[int]] = []
    for x in sorted(set(numbers)):
        if parts and x == parts[-1][1] + 1:
            parts[-1][1] = x
        else:
            parts.append([x, x])
    return ", ".join(str(a) if a == b else f"{a}–{b}" for a, b in parts)
