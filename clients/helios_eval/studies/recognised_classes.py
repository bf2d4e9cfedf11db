"""Table of the classes that a detector recognises, for `helios eval --task-classes`.

A class is in the table of a kind of looks if its rate there is not below the median of all classes
(the upper half), and the detector has a name for it alone: a class that counts only under the name
of another one (an armchair as "chair") is left out, since a detection could be either.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from helios_core.atomic_file import write_file
from helios_core.name_rules import plain
from helios_detector.vocabulary_matching import accepted_names
from helios_sim.home.catalog import Catalog
from helios_sim.home.task_sampling import AMBIGUOUS

from helios_eval.studies.realism_judging import PARAMETRIC, REALISTIC, Row

LEAST_SEEN = 5  # views; a class with fewer realistic ones counts by its parametric rate


def rates_of(rows: Mapping[tuple[str, str], Row], looks: str) -> dict[str, float]:
    """Recognised share of each class in homes of these looks, 0 to 1.

    Realistic homes keep the parametric shape of a class that has no baked model.
    """
    of = {looks, PARAMETRIC}
    found: dict[str, float] = {}
    for (name, kind), row in sorted(rows.items()):  # parametric before realistic
        if kind in of and (row.seen >= LEAST_SEEN or name not in found):
            found[name] = row.recognised / row.seen
    return found


def upper_half(rates: Mapping[str, float]) -> list[str]:
    """Classes whose rate is not below the median of all."""
    middle = statistics.median(rates.values())
    return sorted(name for name, rate in rates.items() if rate >= middle)


def has_own_name(class_name: str, names: Iterable[str]) -> bool:
    """True if the detector's names for a class are its own, its synonyms or narrower kinds."""
    return {plain(name) for name in names} <= accepted_names(class_name)


def word_for(class_name: str, names: Iterable[str]) -> str:
    """The detector's word for a class: its own name if the detector has it."""
    return min(names, key=lambda name: (plain(name) != plain(class_name), name))


def table_text(
    rows: Mapping[tuple[str, str], Row],
    right: Mapping[str, frozenset[str]],
    catalog: Catalog,
    header: Sequence[str],
) -> str:
    """TOML table with a part for each kind of looks that was judged."""
    lines = list(header)
    for looks in (PARAMETRIC, REALISTIC):
        if not any(kind == looks for _, kind in rows):
            continue
        rates = rates_of(rows, looks)
        good = [n for n in upper_half(rates) if n not in AMBIGUOUS and has_own_name(n, right[n])]
        lines += ["", f"[{looks}]", f"least_rate = {statistics.median(rates.values()):.3f}"]
        for key, known in (("objects", catalog.objects), ("receptacles", catalog.receptacles)):
            lines.append(f"[{looks}.{key}]")
            lines += [
                f'"{n}" = "{word_for(n, right[n])}"  # {rates[n]:.0%} recognised'
                for n in good
                if n in known
            ]
    return "\n".join(lines) + "\n"


def write_classes(
    path: Path,
    rows: Mapping[tuple[str, str], Row],
    right: Mapping[str, frozenset[str]],
    catalog: Catalog,
    about: Mapping[str, str],
) -> None:
    """Write the table. about: names with values for its head, such as the model's SHA-256."""
    header = ["# Written by: python -m helios_eval.studies.realism --write-classes FILE"]
    header += [f'{name} = "{value}"' for name, value in about.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, table_text(rows, right, catalog, header))
