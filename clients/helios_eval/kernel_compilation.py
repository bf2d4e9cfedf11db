"""Compiles every numba kernel ahead of time: `python -m helios_eval.kernel_compilation`.

A process reuses the kernels that another process compiled and compiles only the missing ones. The
cache lies in `__pycache__` beside the module, or in the user's cache folder where that is not
writable; `NUMBA_CACHE_DIR` sets another folder. Processes that miss the same kernel at the same
time all compile it, so run this before parallel tests or stacks. numba does not notice a change in
a kernel that another file calls: `make install` deletes all compiled kernels when the file of a
kernel has changed.
"""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache

from helios_map2d.warm_up import warm_up as warm_up_maps
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.warm_up import warm_up as warm_up_objects
from helios_planner.warm_up import warm_up as warm_up_paths

from helios_eval.provenance import usable_cores


def objects() -> None:
    """Compile the object map's kernels, those of our own rules too."""
    warm_up_objects(ObjectMapSettings())
    ours = {
        "evidence": "hindsight",
        "look_alikes": "compared",
        "joined_by": "detections",
        "image_text": "compared",
    }
    warm_up_objects(ObjectMapSettings.model_validate(ours))


# longest compilation first
PARTS = {"objectmap": objects, "map2d": warm_up_maps, "planner": warm_up_paths}


@cache
def warm_up() -> None:
    """Load or compile all kernels in this process, once, so that no step waits for one."""
    for part in PARTS.values():
        part()


def main() -> None:
    """Compile the missing kernels, each service in its own process."""
    began_s = time.monotonic()
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(len(PARTS), usable_cores()), spawn) as pool:
        doing = {pool.submit(part): name for name, part in PARTS.items()}
        for done in as_completed(doing):
            done.result()
            print(f"  {time.monotonic() - began_s:4.0f} s  kernels of {doing[done]}", flush=True)


if __name__ == "__main__":
    main()
