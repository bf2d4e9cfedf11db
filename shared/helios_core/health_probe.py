"""Health check of one service: is it on the bus?

    python -m helios_core.health_probe planner [--unless-cut-off]

It connects as the service does, with the same settings (`HELIOS_CONFIG`, `HELIOS_PLANNER_ROUTER`,
`HELIOS_PLANNER_CERTS` …), and asks for the liveliness token that the service holds while it runs.
Status 0: the service is on the bus. With `--unless-cut-off` also 0 if the router does not answer,
for checks that restart the service. Status 1: it is not; status 2: a setting is wrong. The reason
goes to standard error.
"""

from __future__ import annotations

import argparse
import os
import sys

import zenoh

from helios_core.bus_access import SERVICES
from helios_core.errors import InvalidInput
from helios_core.settings import common_settings
from helios_core.topics import alive_key
from helios_core.zenoh_config import client_config, open_session

ANSWER_WITHIN_S = 3.0


def is_on_bus(session: zenoh.Session, robot: str, service: str) -> bool:
    """True if a process of the service holds its liveliness token."""
    tokens = session.liveliness().get(alive_key(robot, service, "*"), timeout=ANSWER_WITHIN_S)
    return any(reply.ok is not None for reply in tokens)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m helios_core.health_probe")
    parser.add_argument("service", choices=SERVICES)
    parser.add_argument(
        "--unless-cut-off", action="store_true", help="status 0 while the router does not answer"
    )
    given = parser.parse_args(argv)
    service = str(given.service)
    try:
        settings = common_settings(service, os.environ)
        link = settings.router_link(service)
        config = client_config(link)
    except InvalidInput as error:
        print(f"helios-{service}: {error.message}", file=sys.stderr)
        return 2
    try:
        session = open_session(config)[0]
    except zenoh.ZError as error:
        print(f"helios-{service}: no router at {link}: {error}", file=sys.stderr)
        return 0 if given.unless_cut_off else 1
    try:
        alive = is_on_bus(session, settings.robot, service)
    finally:
        session.close()
    if not alive:
        print(f"helios-{service}: no {service} of {settings.robot} on the bus", file=sys.stderr)
    return 0 if alive else 1


if __name__ == "__main__":
    sys.exit(main())
