"""The worker process of the pool in tests: it simulates no world, only the faults of one.

The agent's name selects the fault: "fine", "dies" always, "dies-once", "raises", "impossible",
"hangs". Marks go to the folder that `commit` names.
"""

import os
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path

from eval_constructed_records import record
from helios_core.errors import Unavailable
from helios_eval.episodes.episode_player import PlayedEpisode


def serve(connection: Connection, commit: str, folder: str) -> None:
    while True:
        try:
            spec = connection.recv()
        except EOFError:
            return
        with (Path(commit) / "pids").open("a") as file:
            file.write(f"{os.getpid()}\n")
        mark = Path(commit) / f"{spec.agent}-{spec.seed}"
        if spec.agent == "dies" or (spec.agent == "dies-once" and not mark.exists()):
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if spec.agent == "raises":
            connection.send("no such luck")
        elif spec.agent == "impossible":
            connection.send(Unavailable("no OpenGL context"))
        elif spec.agent == "hangs":
            time.sleep(3600)
        else:
            connection.send(PlayedEpisode(record(spec.seed, agent=spec.agent)))
