"""Compiles every kernel once, before anything waits: `python -m helios_eval.kernel_compilation`.

A process finds what another one has compiled, and compiles only what is missing: beside the module
in `__pycache__`; where that cannot be written, in the user's cache folder; `NUMBA_CACHE_DIR` names
another. Processes that miss the same kernel at the same time all compile it, so tests and houses
side by side want this done before. numba does not see that a kernel has changed which another file
calls: `make install` throws away all that is compiled when a kernel's file has changed.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache

from helios_map2d.warm_up import warm_up as warm_up_maps
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.warm_up import warm_up as warm_up_objects
from helios_planner.warm_up import warm_up as warm_up_paths


def objects() -> None:
    """Those of the object map, whatever counts as evidence: hindsight goes by sides."""
    warm_up_objects(ObjectMapSettings())
    warm_up_objects(ObjectMapSettings(evidence="hindsight"))


PARTS = {"objectmap": objects, "map2d": warm_up_maps, "planner": warm_up_paths}  # longest first


@cache
def warm_up() -> None:
    """Have them all in this process, once, so that no step has to wait for one."""
    for part in PARTS.values():
        part()


def main() -> None:
    """Compile what is missing, a service on each core."""
    began_s = time.monotonic()
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(len(PARTS), os.cpu_count() or 1), spawn) as pool:
        doing = {pool.submit(part): name for name, part in PARTS.items()}
        for done in as_completed(doing):
            done.result()
            print(f"  {time.monotonic() - began_s:4.0f} s  kernels of {doing[done]}", flush=True)


if __name__ == "__main__":
    main()
