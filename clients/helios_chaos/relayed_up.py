"""`helios up` whose services reach the router through relays: `python -m helios_chaos.relayed_up`.

It is the ordinary `helios up`; only the router's address in each service's command line differs.
Services with memory or a clock of their own are started one by one; otherwise they are forked, as
`helios up` does.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, field, replace
from pathlib import Path

from helios_client.supervision.child_process import ProcessSpec
from helios_client.supervision.forked_process import fork_server_for
from helios_client.supervision.service_specs import StackOptions
from helios_client.supervision.up import Screen, up

OWN_SHARED_MEMORY = (
    "unshare",
    "--mount",
    "sh",
    "-c",
    'mount -t tmpfs tmpfs /dev/shm && exec "$@"',
    "sh",
)


@dataclass(frozen=True)
class RelayedStack(StackOptions):
    """Stack behind relays. links: service -> port of its relay; others reach the router itself.

    own_memory: no shared memory between the services, as on separate machines.
    """

    links: dict[str, int] = field(default_factory=dict)
    own_memory: bool = False

    def processes(self) -> tuple[ProcessSpec, ...]:
        return tuple(self._relayed(spec) for spec in super().processes())

    def _relayed(self, spec: ProcessSpec) -> ProcessSpec:
        argv = spec.argv
        if (port := self.links.get(spec.name)) is not None:
            argv = tuple(f"tcp/127.0.0.1:{port}" if a == self.router else a for a in argv)
        if self.own_memory:
            argv = (*OWN_SHARED_MEMORY, *argv)
        return replace(spec, argv=argv)


def main() -> None:
    parser = argparse.ArgumentParser(prog="helios-relayed-up", description=__doc__)
    parser.add_argument("options", help="fields of RelayedStack as JSON")
    options = json.loads(parser.parse_args().options)
    options["state_dir"] = Path(options["state_dir"])
    with fork_server_for(several=options.pop("forked")) as server:
        up(RelayedStack(**options), Screen(), server)


if __name__ == "__main__":
    main()
