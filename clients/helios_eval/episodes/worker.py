"""Worker process that plays one episode after the other on one core.

Call `prepare` before any heavy import: libraries read these environment variables once.
"""

from __future__ import annotations

import logging
import os
import platform
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from helios_eval.episodes.episode_player import PlayedEpisode
    from helios_eval.episodes.episode_spec import EpisodeSpec

# One thread per library, since as many episodes run in parallel as there are cores.
_COUNTS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "LP_NUM_THREADS",
)
ONE_THREAD: dict[str, str] = dict.fromkeys(_COUNTS, "1")


def prepare() -> None:
    """Limit libraries to one thread, and remove service settings from the environment."""
    for name in _service_variables():
        del os.environ[name]
    os.environ.update(ONE_THREAD)
    logging.basicConfig(
        level=logging.ERROR, format="%(asctime)s %(name)s %(levelname)s %(message)s"
    )
    import cv2

    cv2.setNumThreads(1)


@contextmanager
def as_in_a_worker() -> Iterator[None]:
    """Hide service settings in the environment for the duration of the block, and limit OpenCV to
    one thread: an episode in this process is then that of a worker."""
    import cv2

    hidden = {name: os.environ.pop(name) for name in _service_variables()}
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
        os.environ.update(hidden)


def _service_variables() -> list[str]:
    return [name for name in os.environ if name.startswith("HELIOS_")]


@dataclass(frozen=True)
class Skipped:
    """An episode that is not to be played, since its home has no allowed task."""

    reason: str


def play_safely(spec: EpisodeSpec, commit: str) -> PlayedEpisode | Skipped | str:
    """Result of an episode, or the reason why it was skipped or could not be played.

    Raises Unavailable if no episode can be played.
    """
    from helios_core.errors import HeliosError, Unavailable
    from helios_sim.home.task_sampling import NoTask

    from helios_eval.episodes.episode_player import play

    try:
        return play(spec, commit)
    except Unavailable:
        raise
    except NoTask as error:
        return Skipped(error.message)
    except HeliosError as error:
        return error.message
    except Exception as error:
        logging.getLogger(__name__).exception("%s could not be played", spec.key)
        return f"{type(error).__name__}: {error}"


@cache
def _loaded_code() -> str:
    """Commit of the code of this process, at its first episode."""
    from helios_eval import provenance

    return provenance.commit()


def check_code(commit: str) -> None:
    """Raise Unavailable if this process loaded other code than that of the commit."""
    from helios_core.errors import Unavailable

    if _loaded_code() != commit:
        raise Unavailable(
            f"the code of {platform.node()} is {_loaded_code()}, and the run began with {commit}; "
            "give the command again, with the same code on every machine"
        )


def serve(connection: Connection, commit: str, folder: str) -> None:
    """Play the episodes received over the connection, until it closes or the parent process ends.

    folder: for temporary files; the parent process deletes it.

    Each reply is `PlayedEpisode`, the reason why the episode could not be played, or an
    `Unavailable`: also if this process loaded other code than that of the commit.
    """
    threading.Thread(target=_leave_with_parent, name="parent", daemon=True).start()
    prepare()
    tempfile.tempdir = folder
    from helios_core.errors import Unavailable

    _loaded_code()
    answer: Callable[[object], None] = connection.send
    while True:
        try:
            spec = connection.recv()
        except EOFError:
            return
        try:
            check_code(commit)
            answer(play_safely(spec, commit))
        except Unavailable as error:
            answer(error)


def _leave_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
