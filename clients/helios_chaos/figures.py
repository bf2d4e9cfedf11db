"""Percentiles of measured values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def percentiles(values: Sequence[float], *points: int, digits: int = 3) -> dict[str, float | None]:
    """`{"p50": …, "max": …}` of the values: the given percentiles and the largest one.

    A percentile is a measured value, never one between two; None without values.
    """
    out: dict[str, float | None] = {}
    for point in points:
        found = np.percentile(values, point, method="higher") if len(values) else None
        out[f"p{point}"] = None if found is None else round(float(found), digits)
    out["max"] = round(max(values), digits) if len(values) else None
    return out
