"""Study of large maps: cost of a step, memory, and time to save and load, by the size of the map.

    python -m helios_eval.studies.map_scale --out runs/scale

- `ground`: the 2D map after 10, 100 and 1,000 m² (`--areas`) of a flat that is repeated side by
  side. A step there integrates the first frame again, with the scores of two layers.
- `objects`: the object map with 10⁴, 10⁵ and 10⁶ Gaussians (`--gaussians`), of which one scene is
  in view. A step there is an update from a new viewpoint.

It prints a table with the processor time of a step (median), and writes `scale.json` and
`scale.png`. Growth is the ratio of the largest map's step to the smallest one's.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import matplotlib as mpl
import numba
import numpy as np
from helios_core.atomic_file import replacing, write_file
from helios_core.types import Frame, FrameId, Observation, Role, SearchClass, SearchContext
from helios_map2d.epoch_map import EpochMap
from helios_map2d.files.map_file import decode_map, encode_map
from helios_map2d.files.persistence import areas_m2
from helios_map2d.layers.parameters import MapRules
from helios_objectmap import persistence
from helios_objectmap.object_map import ObjectMap
from rich.console import Console
from rich.table import Table

from helios_eval.bench.object_map_benchmarks import CONTEXT as BENCH_CONTEXT
from helios_eval.bench.object_map_benchmarks import (
    map_after_updates,
    shifted_observation,
    tiled_map,
)
from helios_eval.bench.synthetic_flat import frames
from helios_eval.palette import GREEN

mpl.use("Agg")
T = TypeVar("T")
AREAS_M2 = (10.0, 100.0, 1000.0)
GAUSSIANS = (10_000, 100_000, 1_000_000)
PITCH_M = (10.4, 8.4)  # from one flat to the next
ROW = 6  # flats side by side
REPEATS = 40  # of the first frame
UPDATES = 9
COLUMNS = 60  # image columns of the table in `objects`: most of 10,000 Gaussians
SCORES = {"pick": 0.3, "place": 0.6}
CONTEXT = SearchContext(
    "scale",
    (SearchClass("table", Role.START_RECEPTACLE, 0.3), SearchClass("mug", Role.OBJECT, 0.3)),
    {name: name for name in SCORES},
)


@dataclass(frozen=True)
class Scale:
    """Figures of one map."""

    part: str  # ground or objects
    size: float  # m², or Gaussians
    step_ms: float  # processor time
    memory_mb: float
    save_s: float
    load_s: float
    file_mb: float


class Tour:
    """Frames through the same flat again and again, each time beside the last one."""

    def __init__(self) -> None:
        self._seq = 0

    def flat(self, number: int) -> Iterator[Frame]:
        """Frames of the flat of this number, from 0 on."""
        row, column = divmod(number, ROW)
        beside = np.zeros(3)
        beside[:2] = column * PITCH_M[0], row * PITCH_M[1]
        for frame in frames():
            self._seq += 1
            T_world_cam, T_world_base = frame.T_world_cam.copy(), frame.T_world_base.copy()
            T_world_cam[:3, 3] += beside
            T_world_base[:3, 3] += beside
            yield replace(
                frame,
                id=FrameId("scale", 0, self._seq),
                T_world_cam=T_world_cam,
                T_world_base=T_world_base,
            )


def ground(areas_m2_asked: Sequence[float]) -> Iterator[Scale]:
    """2D map after each area."""
    rules = replace(MapRules(), most_leap_m=1e9)
    state, tour, number = EpochMap(rules, (0.0, 0.0), 0.2), Tour(), 0
    state.reset_search(CONTEXT)
    coming = tour.flat(0)
    for area_m2 in sorted(areas_m2_asked):
        while areas_m2(state.published)[0] < area_m2:
            frame = next(coming, None)
            if frame is None:
                number += 1
                coming = tour.flat(number)
                continue
            _step(state, frame)
        again = (next(tour.flat(0)) for _ in range(REPEATS))
        ms = [_cpu_ms(partial(_step, state, frame)) for frame in again]
        data, save_s = _timed(partial(encode_map, state.published, (), None))
        _, load_s = _timed(partial(decode_map, data, rules, 0.2, 1))
        layers = _layer_bytes(state)
        yield Scale(
            "ground",
            round(areas_m2(state.published)[0], 1),
            statistics.median(ms),
            layers / 1e6,
            save_s,
            load_s,
            len(data) / 1e6,
        )


def _step(state: EpochMap, frame: Frame) -> None:
    state.integrate_frame(frame)
    state.integrate_values(Observation(frame, CONTEXT.id, (), SCORES, "scale"))


def _layer_bytes(state: EpochMap) -> int:
    """Bytes of the arrays of all layers over the present grid."""
    stack = state.stack
    layers = [stack.occupancy, stack.search, stack.ground, *stack.values.layers.values()]
    arrays = (a for layer in layers for a in vars(layer).values() if isinstance(a, np.ndarray))
    return sum(a.nbytes for a in arrays)


def objects(sizes: Sequence[int]) -> Iterator[Scale]:
    """Object map of each size."""
    scene = map_after_updates(3, COLUMNS)
    for size in sorted(sizes):
        large = tiled_map(scene, max(1, round(size / len(scene))))
        seen = [shifted_observation(i, COLUMNS) for i in range(10, 11 + UPDATES)]
        ms = [_cpu_ms(partial(large.update, o, BENCH_CONTEXT)) for o in seen]
        data, save_s = _timed(partial(_saved, large))
        _, load_s = _timed(partial(persistence.read, data, large.empty_viewpoints()))
        held = sum(a.nbytes for a in large.content().store.arrays().values())
        yield Scale(
            "objects",
            len(large),
            statistics.median(ms[1:]),
            held / 1e6,
            save_s,
            load_s,
            len(data) / 1e6,
        )


def _saved(objects: ObjectMap) -> bytes:
    return persistence.to_bytes(persistence.arrays_of(objects.content(), None))


def _cpu_ms(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return (time.process_time() - began) * 1e3


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    began = time.perf_counter()
    out = work()
    return out, time.perf_counter() - began


def growth(rows: Sequence[Scale]) -> float:
    """Step of the largest map divided by that of the smallest one."""
    by_size = sorted(rows, key=lambda r: r.size)
    return by_size[-1].step_ms / by_size[0].step_ms


def slope(rows: Sequence[Scale]) -> float:
    """Exponent p of the fit step = c size^p."""
    size, ms = (np.log([getattr(r, name) for r in rows]) for name in ("size", "step_ms"))
    return float(np.polyfit(size, ms, 1)[0])


def table(rows: Sequence[Scale]) -> Table:
    out = Table("map", "size", "step, ms", "memory, MB", "save, s", "load, s", "file, MB")
    for r in rows:
        unit = "m²" if r.part == "ground" else "Gaussians"
        out.add_row(
            r.part,
            f"{r.size:,.0f} {unit}",
            f"{r.step_ms:.2f}",
            f"{r.memory_mb:.1f}",
            f"{r.save_s:.2f}",
            f"{r.load_s:.2f}",
            f"{r.file_mb:.1f}",
        )
    return out


def draw(rows: Sequence[Scale], path: Path) -> None:
    """Chart of the cost of a step by size, with the slope."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), dpi=110, layout="constrained")
    labels = {"ground": "m² of known ground", "objects": "Gaussians in the map"}
    for axis, (part, label) in zip(axes, labels.items(), strict=True):
        own = [r for r in rows if r.part == part]
        axis.set_visible(bool(own))
        if not own:
            continue
        ms = [r.step_ms for r in own]
        axis.plot([r.size for r in own], ms, color=GREEN, marker="o", ms=5)
        axis.set(xscale="log", xlabel=label, ylabel="CPU ms of a step", ylim=(0, 1.6 * max(ms)))
        if len(own) > 1:
            power = f"size to the power {slope(own):.3f}"
            axis.set_title(f"×{growth(own):.2f} over the range, {power}")
        axis.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        figure.savefig(temporary)
    plt.close(figure)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.map_scale",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the figures")
    parser.add_argument("--areas", type=float, nargs="*", default=AREAS_M2, help="m²")
    parser.add_argument("--gaussians", type=int, nargs="*", default=GAUSSIANS)
    given = parser.parse_args(argv)
    numba.set_num_threads(1)  # so that CPU time is the time on one core
    rows = [*ground(given.areas), *objects(given.gaussians)]
    console = Console(width=110)
    console.print(table(rows))
    for part in ("ground", "objects"):
        own = [r for r in rows if r.part == part]
        if len(own) > 1:
            console.print(f"{part}: a step grows by {growth(own):.2f} over the range")
    try:
        draw(rows, given.out / "scale.png")
        write_file(
            given.out / "scale.json", json.dumps([asdict(r) for r in rows], indent=1).encode()
        )
    except OSError as error:
        print(f"map_scale: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
