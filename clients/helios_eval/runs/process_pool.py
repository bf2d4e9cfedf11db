"""Pool of processes that play episodes; a crash of one affects its own episode only.

Processes are spawned, since a fork would copy OpenGL state and threads. Each has its own pipe, so
that a process killed while writing does not disturb the others.
"""

from __future__ import annotations

import fcntl
import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil
from helios_core.errors import HeliosError

from helios_eval.episodes.episode_player import PlayedEpisode
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.episodes.worker import Skipped, serve

_PREFIX = "helios-eval-"
_LOCK = "lock"
_MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None  # for temporary files
ATTEMPTS = 2  # per episode whose process dies

# Or that it was skipped, or the reason why it could not be played.
Outcome = tuple[EpisodeSpec, "PlayedEpisode | Skipped | str"]


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
            return  # `play_all` notices the dead process when it waits

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
    """Outcomes of all episodes, in the order in which they end. serve: main function of a process.

    Closing the iterator kills running processes. Raises Unavailable if nothing can be played.
    """
    _tidy_up()
    with _temporary_folder() as folder:
        context = multiprocessing.get_context("spawn")
        waiting = deque(specs)
        deaths: dict[str, int] = {}
        workers: list[_Worker] = []

        def start() -> None:
            ours, theirs = context.Pipe()
            process = context.Process(target=serve, args=(theirs, commit, folder), daemon=True)
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


@contextmanager
def _interrupts_put_off() -> Iterator[None]:
    """Defer Ctrl-C and SIGTERM to the end of the block.

    Processes started in the block inherit a blocked SIGINT: this process ends them.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    resource_tracker.ensure_running()  # otherwise the first start runs it, which unblocks SIGINT
    held = (signal.SIGINT, signal.SIGTERM)
    former = {number: signal.signal(number, lambda n, _: came.append(n)) for number in held}
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited by processes
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        for number, handler in former.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt(came[0])


@contextmanager
def _temporary_folder() -> Iterator[str]:
    """A new folder for temporary files. It holds a lock while this process lives."""
    prefix = f"{_PREFIX}{os.getpid()}-"
    with (
        TemporaryDirectory(prefix=prefix, dir=_MEMORY, ignore_cleanup_errors=True) as folder,
        Path(folder, _LOCK).open("w") as lock,
    ):
        with suppress(OSError):  # of a file system without locks
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield folder


def _tidy_up() -> None:
    """Delete the temporary folders of runs that were killed."""
    for folder in Path(_MEMORY or tempfile.gettempdir()).glob(f"{_PREFIX}*-*"):
        pid = folder.name.removeprefix(_PREFIX).partition("-")[0]
        if pid.isdecimal() and not psutil.pid_exists(int(pid)) and not _is_locked(folder):
            shutil.rmtree(folder, ignore_errors=True)


def _is_locked(folder: Path) -> bool:
    """True if a live process has the folder, also one of another container, whose process numbers
    mean nothing here."""
    try:
        with (folder / _LOCK).open() as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return False


def _end_reason(worker: _Worker) -> str:
    code = worker.process.exitcode
    how = f"was ended by signal {-code}" if code is not None and code < 0 else f"ended with {code}"
    return f"the process that played it {how}, {ATTEMPTS} times"
