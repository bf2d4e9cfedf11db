"""The CUDA renderer against the CPU renderer: python -m tests.bench.cuda_renderer

Needs a GPU and the extra `cuda`. It renders 12 channels of 640x480 pixels, sums kappa over five
labels, and updates a map, in turns with both renderers. Times include the copies between the
processor's memory and the GPU's, as in the service. The images, the sums and the maps are compared
too.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from helios_eval.bench.object_map_benchmarks import (
    CHANNELS,
    COLUMNS,
    FIRST,
    RUNS,
    SIZES,
    UpdateSequence,
    gaussians_in_view,
    map_after_updates,
    view_of,
)
from helios_eval.bench.synthetic_flat import frames
from helios_eval.bench.timing import Row, compare
from helios_eval.provenance import commit, machine
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.rendering import cpu, cuda
from helios_objectmap.rendering.renderer_interface import Project
from numpy.typing import NDArray

CPU = "CPU renderer"
LABELS = 5
Array = NDArray[np.float32]


def render_row(n: int) -> tuple[Row, dict[str, float]]:
    """(times to project and render n Gaussians, differences of the two images)."""
    means, radius = gaussians_in_view(n)
    opacity = np.full(n, 0.9, np.float32)
    features = np.random.default_rng(2).random((n, CHANNELS - 1), np.float32)
    view = view_of(frames()[0].T_world_cam)

    def by(project: Project) -> Callable[[int], Array]:
        def run(_: int) -> Array:
            projection = project(means, radius, opacity, view)
            return projection.render(features[projection.rows]).features

        return run

    gap = np.abs(by(cuda.project)(0) - by(cpu.project)(0))
    row = compare(
        "render", f"{CHANNELS} channels, {n} Gaussians", by(cuda.project), CPU, by(cpu.project)
    )
    return row, {"mean": float(gap.mean()), "share_over_0.02": float((gap > 0.02).mean())}


def kappa_row(n: int) -> tuple[Row, dict[str, float]]:
    """(times to project n Gaussians and sum kappa per label, relative difference of the sums)."""
    means, radius = gaussians_in_view(n)
    opacity = np.full(n, 0.9, np.float32)
    view = view_of(frames()[0].T_world_cam)
    labels = (np.arange(view.width, dtype=np.int32) * LABELS // view.width)[None]
    labels = np.ascontiguousarray(np.broadcast_to(labels, (view.height, view.width)))

    def by(project: Project) -> Callable[[int], Array]:
        def run(_: int) -> Array:
            projection = project(means, radius, opacity, view)
            out = np.zeros((n, LABELS), np.float32)
            out[projection.rows] = projection.kappa_sums(labels, LABELS)
            return out

        return run

    ours, theirs = by(cuda.project)(0), by(cpu.project)(0)
    row = compare(
        "kappa_sums", f"{LABELS} labels, {n} Gaussians", by(cuda.project), CPU, by(cpu.project)
    )
    return row, {"relative": float(np.abs(ours - theirs).sum() / theirs.sum())}


def update_row() -> tuple[Row, dict[str, float]]:
    """(times of a map's update and query, differences of the two maps at the end)."""
    on_gpu = map_after_updates(FIRST, COLUMNS, renderer="cuda")
    on_cpu = map_after_updates(FIRST, COLUMNS)
    sequence = UpdateSequence()
    row = compare(
        "object_update", "", sequence.updates(on_gpu), CPU, UpdateSequence().updates(on_cpu), RUNS
    )
    size = f"{len(on_gpu)} Gaussians in the map at the end, {sequence.median} in view"
    return Row(**{**vars(row), "size": size}), _map_differences(on_gpu, on_cpu)


def _map_differences(a: ObjectMap, b: ObjectMap) -> dict[str, float]:
    """Sizes of two maps of one scene, and the largest difference of Ψ."""
    ours, theirs = (sorted(m.objects(), key=lambda o: -o.gaussians) for m in (a, b))
    apart = [abs(o.score - t.score) for o, t in zip(ours, theirs, strict=False)]
    return {
        "gaussians": len(a),
        "gaussians_cpu": len(b),
        "objects": len(ours),
        "objects_cpu": len(theirs),
        "psi": max(apart, default=0.0),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print a table, and write JSON if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args(arguments)
    cuda.require()
    import torch

    rows = [render_row(n) for n in SIZES] + [kappa_row(n) for n in SIZES] + [update_row()]
    for row, gap in rows:
        print(
            f"{row.name:14} {row.size:60} CUDA {row.ours_ms:8.2f} ms  CPU {row.peer_ms:8.2f} ms  "
            f"ratio {row.ratio:6.2f}  {gap}"
        )
    if chosen.json is not None:
        document = {
            "machine": machine(),
            "gpu": torch.cuda.get_device_name(),
            "torch": torch.__version__,
            "commit": commit(),
            "rows": [row.as_dict() | {"differences": gap} for row, gap in rows],
        }
        chosen.json.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
