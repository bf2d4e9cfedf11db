"""Plays episodes on a Ray cluster; every machine of it needs HELIOS installed."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager

from helios_core.errors import Unavailable

from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.episodes.worker import ONE_THREAD, check_code, play_safely, prepare
from helios_eval.runs.process_pool import ATTEMPTS, Outcome

LOCAL = "local"


def play_all_on_ray(specs: Sequence[EpisodeSpec], address: str, commit: str) -> Generator[Outcome]:
    """Outcomes as from `process_pool.play_all`. address: a cluster, or "local" for this machine.

    Raises Unavailable without Ray, or without a cluster at the address.
    """
    try:
        import ray  # pyright: ignore[reportMissingImports]
        from ray.exceptions import (  # pyright: ignore[reportMissingImports]
            RayError,
            RayTaskError,
        )
    except ImportError as error:
        raise Unavailable(f"Ray is missing ({error}); pip install 'helios-ovmm[ray]'") from error
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # sends no usage statistics
    try:
        with _sigterm_kept():
            ray.init(
                address=None if address == LOCAL else address,
                runtime_env={"env_vars": ONE_THREAD},
                include_dashboard=False if address == LOCAL else None,
                log_to_driver=False,
                logging_level=logging.ERROR,
            )
    except Exception as error:  # Ray raises no specific exception here
        raise Unavailable(f"no Ray cluster at {address} ({error}); see `ray status`") from error
    # A dead process loses only its own episode; Ray retries as often as `process_pool`.
    remote = ray.remote(num_cpus=1, max_retries=ATTEMPTS - 1)(_played)
    try:
        running = {remote.remote(spec, commit): spec for spec in specs}
        while running:
            (ended, *_), _ = ray.wait(list(running), num_returns=1)
            spec = running.pop(ended)
            try:
                came = ray.get(ended)
            except RayTaskError as error:
                raise error.as_instanceof_cause() from error
            except RayError as error:  # crash, out of memory, or lost machine
                came = f"the process that played it died, {ATTEMPTS} times ({type(error).__name__})"
            yield spec, came
    finally:
        ray.shutdown()


@contextmanager
def _sigterm_kept() -> Iterator[None]:
    """Restore the SIGTERM handler that Ray replaces with one that prints a stack and exits."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, former)


def _played(spec: EpisodeSpec, commit: str) -> object:
    prepare()
    check_code(commit)
    return play_safely(spec, commit)
