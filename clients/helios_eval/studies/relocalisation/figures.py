"""Figures of the study."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from rich.table import Table

from helios_eval.studies.relocalisation.judging import HomeOutcome, SecondVisit


def table(done: Sequence[HomeOutcome], sensor: str) -> Table:
    """Figures over homes."""
    out = Table("figure", f"sensor {sensor}", title=f"{len(done)} homes")
    for name, value in figures(done).items():
        out.add_row(name, value)
    return out


def figures(done: Sequence[HomeOutcome]) -> dict[str, str]:
    """Each figure by its name."""
    right = [one.own for one in done if one.own.is_right]
    found = [one.own for one in done if one.own.step]
    errors_m = [o.error_m for o in found]
    errors_deg = [math.degrees(o.error_rad) for o in found]
    both = [(o.first_found_step, o.second) for o in done if o.second and o.second.found_step]
    visits = [o.second for o in done if o.second is not None]
    known = [one for one in done if one.starts_on_known_floor]
    known_right = sum(one.own.is_right for one in known)
    relocalised = sum(v.place_step > 0 for v in visits)
    again = [float(b.found_step) for _, b in both]
    without = [v for v in visits if v.without_map_step]
    of_both = [(v.without_map_step, v) for v in without if v.found_step]
    return {
        "relocalised after at most 40 actions": _share(len(right), len(done)),
        "- of starts on floor that the saved map knows": _share(known_right, len(known)),
        "actions until then (median, largest)": _middle([float(o.step) for o in right], 0),
        "error of the position (median, largest), m": _middle(errors_m, 3),
        "error of the heading (median, largest), degrees": _middle(errors_deg, 2),
        "false fixes in the same home": _share(sum(o.own.is_false for o in done), len(done)),
        "false fixes in another home": _share(sum(o.other.is_false for o in done), len(done)),
        "second visits that relocalised": _share(relocalised, len(visits)),
        "false fixes of second visits": _share(sum(v.is_false for v in visits), len(visits)),
        "second visits that found the object": _share(len(both), len(visits)),
        "actions to find: first visit (median)": _middle([float(a) for a, _ in both], 0),
        "actions to find: second visit (median)": _middle(again, 0),
        "second visit in shares of the first (sum of actions)": _ratio(both),
        "visits from the same starts without the map that found it": _share(
            len(without), len(visits)
        ),
        "second visit in shares of these (sum of actions)": _ratio(of_both),
    }


def _share(count: int, of: int) -> str:
    return f"{count} of {of}" + (f" ({count / of:.0%})" if of else "")


def _middle(values: Sequence[float], digits: int) -> str:
    if not values:
        return "-"
    return f"{np.median(values):.{digits}f}, {max(values):.{digits}f}"


def _ratio(both: Sequence[tuple[int, SecondVisit]]) -> str:
    if not both:
        return "-"
    first, second = sum(a for a, _ in both), sum(b.found_step for _, b in both)
    return f"{second / first:.2f}"
