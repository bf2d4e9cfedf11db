"""Episodes on many cores: one process each, and what one of them breaks stays with it.

Processes are spawned, not forked: a fork would carry OpenGL and threads along. Each has a pipe of
its own, so that one that is killed while it writes leaves the others in peace.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

import psutil
from helios_core.errors import HeliosError

from helios_eval.episodes.episode_player import Played
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.episodes.worker import serve

_PREFIX = "helios-eval-"
_MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None  # for temporary files
ATTEMPTS = 2  # at an episode of which the process died

Outcome = tuple[EpisodeSpec, "Played | str"]  # a sentence where it could not be played


@dataclass(eq=False)
class _Worker:
    process: BaseProcess
    connection: Connection
    spec: EpisodeSpec | None = None

    def give(self, spec: EpisodeSpec) -> None:
        self.spec = spec
        try:
            self.connection.send(spec)
        except OSError:
            return  # it is dead: noticed when it is waited for

    def kill(self) -> None:
        self.process.kill()
        self.process.join()
        self.connection.close()


def play_all(
    specs: Sequence[EpisodeSpec],
    jobs: int,
    commit: str,
    serve: Callable[[Connection, str, str], None] = serve,
) -> Generator[Outcome]:
    """The outcome of every episode, in the order in which they end. serve: what a process does.

    Closing the iterator kills what still runs. Raises Unavailable where nothing can be played.
    """
    _tidy_up()
    folder = tempfile.TemporaryDirectory(prefix=f"{_PREFIX}{os.getpid()}-", dir=_MEMORY)
    context = multiprocessing.get_context("spawn")
    waiting = deque(specs)
    deaths: dict[str, int] = {}
    workers: list[_Worker] = []

    def start() -> None:
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs, commit, folder.name), daemon=True)
        with _interrupts_put_off():
            process.start()
            workers.append(_Worker(process, ours))
        theirs.close()
        workers[-1].give(waiting.popleft())

    try:
        while waiting or workers:
            while waiting and len(workers) < jobs:
                start()
            ready = wait([w.connection for w in workers])
            for worker in [w for w in workers if w.connection in ready]:
                spec = worker.spec
                assert spec is not None
                try:
                    came = worker.connection.recv()
                except (EOFError, OSError):
                    workers.remove(worker)
                    worker.kill()
                    deaths[spec.key] = deaths.get(spec.key, 0) + 1
                    if deaths[spec.key] < ATTEMPTS:
                        waiting.appendleft(spec)
                    else:
                        yield spec, _end_reason(worker)
                    continue
                if isinstance(came, HeliosError):
                    raise came
                if waiting:
                    worker.give(waiting.popleft())
                else:
                    workers.remove(worker)
                    worker.kill()
                yield spec, came
    finally:
        for worker in workers:
            worker.kill()
        folder.cleanup()


@contextmanager
def _interrupts_put_off() -> Iterator[None]:
    """Ctrl-C and SIGTERM wait; processes that are started meanwhile never get the former: this one
    ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    resource_tracker.ensure_running()  # else the first start does it, and unblocks SIGINT after it
    held = (signal.SIGINT, signal.SIGTERM)
    former = {number: signal.signal(number, lambda n, _: came.append(n)) for number in held}
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        for number, handler in former.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt(came[0])


def _tidy_up() -> None:
    """Take away what runs left that were killed."""
    for folder in Path(_MEMORY or tempfile.gettempdir()).glob(f"{_PREFIX}*-*"):
        pid = folder.name.removeprefix(_PREFIX).partition("-")[0]
        if pid.isdecimal() and not psutil.pid_exists(int(pid)):
            shutil.rmtree(folder, ignore_errors=True)


def _end_reason(worker: _Worker) -> str:
    code = worker.process.exitcode
    how = f"was ended by signal {-code}" if code is not None and code < 0 else f"ended with {code}"
    return f"the process that played it {how}, {ATTEMPTS} times"
