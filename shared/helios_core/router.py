"""Zenoh router as a Python process: `python -m helios_core.router --listen tcp/127.0.0.1:7447`.

It listens on loopback by default. Beyond loopback use mTLS and access control
(`deploy/router.json5`).
"""

from __future__ import annotations

import argparse
import sys
import threading

import zenoh

from helios_core.service_process import stop_on_signals
from helios_core.zenoh_config import router_config


def main() -> int:
    parser = argparse.ArgumentParser(prog="helios-router", description=__doc__)
    parser.add_argument("--listen", default="tcp/127.0.0.1:7447", help="endpoint to listen on")
    parser.add_argument("--config", help="a Zenoh JSON5 file instead of the built-in settings")
    args = parser.parse_args()
    stopped = threading.Event()
    stop_on_signals(stopped)
    try:
        config = zenoh.Config.from_file(args.config) if args.config else router_config(args.listen)
        session = zenoh.open(config)
    except zenoh.ZError as error:
        print(
            f"helios-router: cannot listen on {args.listen} ({error}); is the port in use? "
            "choose another with --listen",
            file=sys.stderr,
        )
        return 1
    stopped.wait()
    session.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
