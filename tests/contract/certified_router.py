"""A router with the certificates of `helios certs`, and a witness that may do everything there."""

from __future__ import annotations

import datetime as dt
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import zenoh
from helios_client.certs import folder as files
from helios_client.certs.authority import KeyPair, new_client
from helios_client.certs.names import Names
from helios_core.access_control import Identity
from helios_core.router_link import ROUTER_FILE, SESSIONS, RouterLink
from helios_core.zenoh_config import Credentials, client_config, client_values

from tests.support import ENDS_WITHIN_S, free_port, wait_until

WITNESS = "witness"
MARKS = "test/**"  # keys that every certificate may use, so that a test knows when it is through
WITHIN_S = 30.0
EVERYTHING = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


@dataclass(frozen=True)
class Certified:
    """A running router under generated access rules."""

    folder: Path
    port: int
    identities: tuple[Identity, ...]

    @property
    def endpoint(self) -> str:
        return f"tls/127.0.0.1:{self.port}"

    def link(self, name: str) -> RouterLink:
        return RouterLink(self.endpoint, self.folder / SESSIONS / f"{name}.json5")

    def session(self, name: str, mode: str = "client") -> zenoh.Session:
        """Open session of a certificate. Raises zenoh.ZError if the router refuses it."""
        config = client_config(self.link(name))
        config.insert_json5("mode", json.dumps(mode))
        return zenoh.open(config)


@contextmanager
def certified_router(folder: Path, names: Names) -> Iterator[Certified]:
    """Create the certificates, and run a router with them. The test's own witness is added."""
    now = dt.datetime.now(dt.UTC)
    files.create(folder, names, 10, now)
    add_witness(folder, now)
    port = free_port()
    argv = [
        sys.executable,
        "-m",
        "helios_core.router",
        "--certs",
        str(folder),
        "--listen",
        f"tls/127.0.0.1:{port}",
    ]
    process = subprocess.Popen(argv)
    out = Certified(folder, port, names.identities)
    try:
        wait_until(lambda: _lets_in(out), WITHIN_S, "the router lets the witness in")
        yield out
    finally:
        process.terminate()
        assert process.wait(ENDS_WITHIN_S) == 0


def write_session(folder: Path, name: str, authority: KeyPair, own: KeyPair) -> None:
    """Write the session file of a certificate."""
    credentials = Credentials(authority.certificate, own.certificate, own.key)
    file = folder / SESSIONS / f"{name}.json5"
    file.write_text(json.dumps(client_values([], credentials)))
    file.chmod(0o600)


def authority_of(folder: Path) -> KeyPair:
    return KeyPair((folder / "ca.pem").read_bytes(), (folder / "ca.key").read_bytes())


def add_witness(folder: Path, now: dt.datetime) -> None:
    """Add a certificate that may do everything, and the keys `MARKS` for everyone."""
    authority = authority_of(folder)
    write_session(folder, WITNESS, authority, new_client(authority, WITNESS, 1, now))
    router = folder / ROUTER_FILE
    values = json.loads(router.read_text())
    access = values["access_control"]
    everyone = [subject["id"] for subject in access["subjects"]]
    access["subjects"].append({"id": WITNESS, "cert_common_names": [WITNESS]})
    for id, keys, subjects in (
        ("all", ["**", "**/@adv/**"], [WITNESS]),
        ("marks", [MARKS], everyone),
    ):
        access["rules"].append(
            {
                "id": id,
                "permission": "allow",
                "flows": ["ingress", "egress"],
                "messages": list(EVERYTHING),
                "key_exprs": keys,
            }
        )
        access["policies"].append({"rules": [id], "subjects": subjects})
    router.write_text(json.dumps(values))


def _lets_in(router: Certified) -> bool:
    with suppress(zenoh.ZError):
        router.session(WITNESS).close()
        return True
    return False
