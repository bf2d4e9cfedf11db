"""Study of the object map's growth: cost per frame, objects only or full scene, long runs.

    python -m helios_eval.studies.object_map_growth --out runs/growth

`cost` maps 2,000 frames of homes that are new to the map, and plots the time of an update against
the Gaussians mapped. `scene` is Figure 4 of the paper: one episode with objects only and with every
pixel modelled. `hours` sends eight hours of frames (one every 4 s) through the object map's process
and plots its memory. Writes `growth.json` and a chart of each. Exit status 1 if the memory of
`hours` still grows at the end.

    python -m helios_eval.studies.object_map_growth --only episodes --stride 2 --out runs/memory

`episodes` is Figure 4 over many homes. It writes each episode to `episodes.jsonl`, and after each
`memory.md`, `memory.json` and `memory.png`. The same command continues a run that ended early.
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numba
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError

from helios_eval.run_folder import locked_folder
from helios_eval.studies.development_homes import homes, seeds
from helios_eval.studies.map_growth import (
    full_scene_comparison,
    long_run,
    memory_by_episode,
    observation_log,
    plots,
    update_cost,
)
from helios_eval.studies.map_growth.simulated_walk import Walk, record

PARTS = ("cost", "scene", "hours")  # run unless --only selects some
EPISODES = "episodes"


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.object_map_growth",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for figures and pictures")
    parser.add_argument("--only", default=",".join(PARTS), help=f"some of these, or {EPISODES}")
    parser.add_argument("--preset", default="ovmm-v1", help="kind of homes")
    parser.add_argument("--seeds", type=seeds, default=(0, 1), help="homes that are walked through")
    parser.add_argument("--walk", type=int, default=100, help="frames of each home's walk")
    parser.add_argument("--stride", type=int, default=4, help="every n-th pixel, both ways")
    parser.add_argument("--frames", type=int, default=2000, help="of `cost`")
    parser.add_argument("--episode", type=int, default=0, help="seed of `scene`")
    parser.add_argument(
        "--max-steps", type=int, default=300, help="of each episode, in `scene` and `episodes`"
    )
    parser.add_argument("--seed0", type=int, default=500, help="first home of `episodes`")
    parser.add_argument("--homes", type=int, default=50, help="of `episodes`")
    parser.add_argument("--hours", type=float, default=8.0, help="robot time of `hours`")
    parser.add_argument("--every-s", type=float, default=4.0, help="robot time between frames")
    parser.add_argument(
        "--max-gaussians", type=int, help="limit of the map in `hours`  [default: the service's]"
    )
    given = parser.parse_args(arguments)
    given.only = given.only.split(",")
    known = (*PARTS, EPISODES)
    if not set(given.only) <= set(known):
        parser.error(f"--only {','.join(given.only)} is not known; give some of {','.join(known)}")
    if given.homes < 1 or given.max_steps < 1:
        parser.error("--homes and --max-steps want a number above 0")
    return given


def memory(given: argparse.Namespace) -> dict[str, object]:
    """Play the episodes that the folder lacks; values over all. Raises HeliosError."""
    homes(given.seed0, given.homes)
    asked = memory_by_episode.Request(
        given.preset, given.seed0, given.homes, given.max_steps, given.stride
    )
    with locked_folder(given.out):
        memory_by_episode.play(given.out, asked)
        played = memory_by_episode.read(given.out, asked)
        memory_by_episode.write(given.out, played, asked)
    return memory_by_episode.summary(played, asked)


def main(arguments: Sequence[str] | None = None) -> int:
    given = parsed(arguments)
    numba.set_num_threads(1)  # so that CPU time is the time on one core

    @functools.cache
    def walks() -> tuple[Walk, ...]:
        return tuple(record(given.preset, s, given.walk, given.stride) for s in given.seeds)

    found: dict[str, object] = {}
    steady = True
    try:
        if "cost" in given.only:
            costs = update_cost.measure(walks(), given.frames)
            plots.cost(costs, given.out / "cost.png")
            found["cost"] = costs.summary()
        if "scene" in given.only:
            homes(given.episode, 1)
            seen = observation_log.play(given.preset, given.episode, given.max_steps, given.stride)
            maps = full_scene_comparison.measure(seen)
            plots.scene(maps, given.out / "scene.png")
            found["scene"] = {"frames": len(seen)} | {n: m.summary() for n, m in maps.items()}
        if "hours" in given.only:
            frames = round(given.hours * 3600 / given.every_s)
            lived = long_run.measure(walks(), frames, given.every_s, given.max_gaussians)
            plots.hours(lived, given.out / "hours.png")
            found["hours"], steady = lived.summary(), lived.is_steady
        if EPISODES in given.only:
            found[EPISODES] = memory(given)
    except HeliosError as error:
        print(f"object_map_growth: {error.message}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("object_map_growth: interrupted; played episodes are kept", file=sys.stderr)
        return 130
    text = json.dumps({"stride_px": given.stride} | found, indent=1)
    write_file(given.out / "growth.json", text + "\n")
    print(text)
    if not steady:
        print("object_map_growth: memory still grows at the end", file=sys.stderr)
    return 0 if steady else 1


if __name__ == "__main__":
    sys.exit(main())
