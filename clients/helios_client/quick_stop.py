"""`helios stop` without slow imports. Imports only the standard library.

It does the same as the command in `commands.robot` if all goes well. In any other case (help, wrong
use, no gateway, a refusal, no confirmation) it returns None; that command then stops the robot and
reports the error. A second stop does no harm.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from helios_client.leading_options import leading

if TYPE_CHECKING:
    from http.client import HTTPConnection
    from urllib.parse import SplitResult

REASON = "helios stop"
SENTENCE = "stopped; the robot will not move until you run: helios clear-stop"
CONNECT_S = 3.0
TIMEOUT_S = 10.0
VALUES = ("--port", "--url", "--key", "--robot", "--reason")
FLAGS = ("--json",)
VARIABLES = {"--key": "HELIOS_API_KEY"}


def quick_stop(args: Sequence[str]) -> int | None:
    """Stop the robot if `args`, the command line after `helios`, is `stop` with its options.
    Returns the exit status, or None if the full command must run."""
    before, rest = leading(args)
    if rest[:1] != ["stop"]:
        return None
    given = options([*before, *rest[1:]], os.environ)
    if given is None:
        return None
    import http.client

    try:
        text = _ask(given, os.environ)
        print(text, flush=True)
    except (OSError, ValueError, LookupError, TypeError, ImportError, http.client.HTTPException):
        return None
    return 0


def options(args: Sequence[str], environment: Mapping[str, str]) -> dict[str, str] | None:
    """Options by name, with the API key of the environment; a flag has the value "". None if an
    argument is not understood."""
    out = {name: value for name, key in VARIABLES.items() if (value := environment.get(key))}
    left = iter(args)
    for arg in left:
        name, equals, value = arg.partition("=")
        if name in FLAGS and not equals:
            out[name] = ""
        elif name in VALUES:
            given = value if equals else next(left, None)
            if given is None:
                return None
            out[name] = given
        else:
            return None
    port = out.get("--port", "1")
    well = port.isascii() and port.isdecimal() and len(port) <= 5 and 0 < int(port) < 65536
    return out if well else None


def _ask(given: Mapping[str, str], environment: Mapping[str, str]) -> str:
    """Send the stop request and return the text to print. Raises OSError, ValueError, LookupError,
    TypeError or HTTPException on any failure, also if the answer does not confirm the stop."""
    import json
    from urllib.parse import quote

    from helios_client.http.address import chosen, split_url

    port = int(given["--port"]) if "--port" in given else None
    url = split_url(chosen(port, given.get("--url"), environment)[1])
    if url.username is not None:
        raise ValueError("a user in the address")
    robot = given.get("--robot")
    prefix = f"/v1/robots/{quote(robot, safe='')}" if robot else "/v1"
    headers = {"content-type": "application/json"}
    if key := given.get("--key"):
        headers["authorization"] = f"Bearer {key}"
    body = json.dumps({"reason": given.get("--reason", REASON)})
    connection = _connection(url)
    try:
        connection.connect()
        connection.sock.settimeout(TIMEOUT_S)
        connection.request("POST", f"{url.path.rstrip('/')}{prefix}/robot/stop", body, headers)
        response = connection.getresponse()
        answer: Any = json.loads(response.read())
    finally:
        connection.close()
    if not 200 <= response.status < 300:
        raise ValueError("refused")
    if answer["state"]["stopped"] is not True:
        raise ValueError("not confirmed")
    return json.dumps(answer, indent=1) if "--json" in given else SENTENCE


def _connection(url: SplitResult) -> HTTPConnection:
    from http.client import HTTPConnection, HTTPSConnection

    assert url.hostname is not None
    if url.scheme == "http":
        return HTTPConnection(url.hostname, url.port, timeout=CONNECT_S)
    import ssl

    import certifi  # certificate authorities that the SDK trusts

    context = ssl.create_default_context(cafile=certifi.where())
    return HTTPSConnection(url.hostname, url.port, timeout=CONNECT_S, context=context)


def main() -> int | None:
    """Exit status, or None if the full command must run."""
    try:
        return quick_stop(sys.argv[1:])
    except KeyboardInterrupt:
        print("helios: interrupted", file=sys.stderr)
        return 130
