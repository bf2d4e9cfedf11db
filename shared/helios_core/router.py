"""Zenoh router as a Python process: `python -m helios_core.router --listen tcp/127.0.0.1:7447`.

It listens on loopback by default. Beyond loopback use certificates: `--certs DIR`, with the folder
of `helios certs init DIR`.
"""

from __future__ import annotations

import argparse
import sys
import threading
from pathlib import Path

import zenoh

from helios_core.errors import InvalidInput
from helios_core.router_link import ROUTER_FILE, TLS
from helios_core.signal_handling import stop_on_signals
from helios_core.zenoh_config import open_session, router_config, router_config_of_file

DEFAULT_LISTEN = "tcp/127.0.0.1:7447"


def arguments() -> argparse.ArgumentParser:
    """Command line of the router."""
    parser = argparse.ArgumentParser(prog="helios-router", description=__doc__)
    parser.add_argument(
        "--listen", help=f"endpoint to listen on; default {DEFAULT_LISTEN}, or that of --certs"
    )
    parser.add_argument("--certs", type=Path, help="folder of helios certs: TLS, access control")
    return parser


def main() -> int:
    args = arguments().parse_args()
    stopped = threading.Event()
    stop_on_signals(stopped)
    try:
        config = _config(args.listen, args.certs)
    except InvalidInput as error:
        print(f"helios-router: {error.message}", file=sys.stderr)
        return 2
    try:
        session, _ = open_session(config)
    except zenoh.ZError as error:
        where = args.listen or (f"the endpoint in {args.certs}" if args.certs else DEFAULT_LISTEN)
        print(
            f"helios-router: cannot listen on {where} ({error}); is the port in use? choose "
            "another with --listen",
            file=sys.stderr,
        )
        return 1
    stopped.wait()
    session.close()
    return 0


def _config(listen: str | None, certs: Path | None) -> zenoh.Config:
    """Raises InvalidInput for an unusable folder, or an endpoint that is not encrypted."""
    if certs is None:
        return router_config(listen or DEFAULT_LISTEN)
    if listen is not None and not listen.startswith(TLS):
        raise InvalidInput(f"--listen {listen} takes no certificates; write {TLS}HOST:PORT")
    return router_config_of_file(certs / ROUTER_FILE, listen)


if __name__ == "__main__":
    sys.exit(main())
