"""Fork server: imports the libraries of the services once, and forks each service.

`python -m helios_client.supervision.fork_server FD PID`. `forked_process.py` sends it requests over
the socket FD, in JSON:

    {"module": "helios_map2d", "args": ["--router", …], "log": "/…/map2d.log"}  ->  {"pid": 123}

The answer is `{"error": reason}` if this process has a second thread: a fork copies only one, and
the locks that others hold stay locked in the copy. So this process opens no bus and runs no
parallel kernel, and the numerical libraries get one thread each. The services start theirs after
the fork.

The child of a child becomes the service. Linux gives it to PID, the supervisor, which can thus wait
for it as for any child. The end of this process ends no service.
"""

from __future__ import annotations

import functools
import gc
import importlib
import json
import os
import random
import runpy
import signal
import socket
import sys
import time
from contextlib import suppress
from typing import NamedTuple

MESSAGE_BYTES = 1 << 16
SHARED = (
    "setproctitle",
    "helios_core.codec",
    "helios_core.service_process",
    "helios_core.zenoh_bus",
)
HAVE_KERNELS = frozenset({"helios_map2d", "helios_objectmap", "helios_planner"})
PR_SET_PDEATHSIG = 1
NAME = "helios_client.supervision.fork_server"
TITLE_BYTES = 1024  # room for the command line of a service, in the command line of this process
KEEP_ENVIRONMENT = {"SPT_NOENV": "1"}  # else the title overwrites it, and tools read nonsense


class Request(NamedTuple):
    """Service to start: its module, its arguments, the file for its output."""

    module: str
    args: list[str]
    log: str


def main(descriptor: int, supervisor: int) -> None:
    """Answer requests until the supervisor ends. In a forked process it runs the service."""
    _import(SHARED)
    _show_as((sys.executable, "-m", NAME))
    with socket.socket(fileno=descriptor) as requests:
        request = _serve(requests)
    if request is not None:
        _become(request, supervisor)


def _serve(requests: socket.socket) -> Request | None:
    """Fork a service per request. Returns the request in each forked process, None at the end."""
    while message := requests.recv(MESSAGE_BYTES):
        request = Request(**json.loads(message))
        if request.module in HAVE_KERNELS:
            _prepare_numba()
        gc.collect()
        gc.freeze()  # the collector does not write to memory that is shared with the services
        threads = os.listdir("/proc/self/task")
        if len(threads) > 1:
            answer = {"error": f"the fork server has {len(threads)} threads"}
        else:
            pid = _fork()
            if pid is None:
                return request
            answer = {"pid": pid}
        requests.send(json.dumps(answer).encode())
    return None


def _fork() -> int | None:
    """Process id of a grandchild that leads a session of its own; None in the grandchild."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        middle = os.getpid()
        if os.fork():
            os._exit(0)
        os.setsid()
        while os.getppid() == middle:
            time.sleep(0.001)
        os.write(write, str(os.getpid()).encode())
        os.close(read)
        os.close(write)
        return None
    os.close(write)
    with open(read, "rb") as pipe:
        pid = int(pipe.read())
    os.waitpid(child, 0)
    return pid


def _become(request: Request, supervisor: int) -> None:
    """Run the service as `python -m MODULE ARG …` would."""
    _end_with(supervisor)
    _write_to(request.log)
    _draw_other_numbers()
    sys.argv = [request.module, *request.args]
    _show_as((sys.executable, "-m", *sys.argv))
    runpy.run_module(request.module, run_name="__main__", alter_sys=True)


def _draw_other_numbers() -> None:
    """Seed the global generators anew, which are equal in all copies."""
    random.seed()
    if (of_numpy := sys.modules.get("numpy.random")) is not None:
        of_numpy.seed()


def _end_with(supervisor: int) -> None:
    import ctypes

    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != supervisor:  # it ended before the call
        sys.exit("the supervisor is gone")


def _write_to(log: str) -> None:
    into = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    os.dup2(into, 1)
    os.dup2(into, 2)
    os.close(into)


def _show_as(argv: tuple[str, ...]) -> None:
    """Show this command line in the list of processes."""
    import setproctitle

    setproctitle.setproctitle(" ".join(argv))


@functools.cache
def _prepare_numba() -> None:
    """Import Numba and compile one line, which loads the tables that every kernel needs."""
    with suppress(ImportError):
        import numba
        import numpy as np

        numba.njit(lambda values: values[0])(np.zeros(1))


def _import(modules: tuple[str, ...]) -> None:
    for name in modules:
        with suppress(ImportError):  # the service reports what it lacks
            importlib.import_module(name)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
