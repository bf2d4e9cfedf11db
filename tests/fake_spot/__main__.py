"""`python -m tests.fake_spot`: a robot for trying the driver; runs until Ctrl-C."""

from __future__ import annotations

import argparse
import shlex
import signal
import tempfile
import threading
from pathlib import Path

from tests.fake_spot.cameras import sources
from tests.fake_spot.rooms import tea_room
from tests.fake_spot.server import FakeSpot
from tests.fake_spot.world import World


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fake_spot", description=__doc__)
    parser.add_argument(
        "--folder", type=Path, help="where its certificate goes; a new one if unset"
    )
    parser.add_argument("--hurry", type=float, default=1.0, help="walks so many times as fast")
    parser.add_argument("--skew-s", type=float, default=0.0, help="its clock is so far ahead")
    parser.add_argument("--size", default="640x480", help="of the hand's images")
    args = parser.parse_args()
    folder = args.folder or Path(tempfile.mkdtemp(prefix="fake-spot-"))
    folder.mkdir(parents=True, exist_ok=True)
    cols, rows = (int(v) for v in args.size.split("x"))
    world = World(*tea_room(), skew_s=args.skew_s, hurry=args.hurry)
    fake = FakeSpot(folder, world, sources(cols, rows))
    for name, value in fake.environment.items():
        print(f"export {name}={shlex.quote(value)}", flush=True)
    stopped = threading.Event()
    for which in (signal.SIGINT, signal.SIGTERM):
        signal.signal(which, lambda *_: stopped.set())
    stopped.wait()
    fake.close()


if __name__ == "__main__":
    main()
