"""The router's access control list, generated from the table in `bus_access`.

Zenoh checks every message between the router and a client: *ingress* is what the client sends,
*egress* what it gets. Everything that no rule allows is denied. `docs/explanation/security.md` says
what Zenoh does not check.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from helios_core.bus_access import FLEET, FLEET_BUS, Access, access_of
from helios_core.topics import ROOT, QoS, Topic

Flow = Literal["ingress", "egress"]
Keys = dict[tuple[Flow, str], dict[str, None]]  # (flow, message) -> key expressions, in order

SIMULATED_WORLD = "world"


@dataclass(frozen=True)
class Identity:
    """Holder of one certificate: its name (CN), what it runs, and for which robots."""

    name: str
    service: str  # a key of `ACCESS`
    robots: tuple[str, ...]


def access_control(identities: Iterable[Identity]) -> dict[str, Any]:
    """Zenoh's `access_control` for these certificates. Raises KeyError for an unknown service."""
    known = tuple(identities)
    simulated = {r for i in known if i.service == SIMULATED_WORLD for r in i.robots}
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for identity in known:
        own = _rules(identity, simulated)
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [identity.name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": i.name, "cert_common_names": [i.name]} for i in known],
        "policies": policies,
    }


def allowed_keys(identity: Identity, simulated: Iterable[str] = ()) -> Keys:
    """Key expressions that a certificate's holder may use, for each flow and message.

    simulated: robots whose world is simulated, so that their detector may use the truth.
    """
    out: Keys = defaultdict(dict)
    for robot in identity.robots:
        _allow(out, access_of(identity.service, simulated=robot in simulated), robot)
    if identity.service == "detector":
        _allow(out, FLEET, FLEET_BUS)
    return out


def _rules(identity: Identity, simulated: Iterable[str]) -> list[dict[str, Any]]:
    """One rule for each flow and set of keys."""
    messages: dict[tuple[Flow, tuple[str, ...]], list[str]] = defaultdict(list)
    for (flow, message), keys in allowed_keys(identity, simulated).items():
        if keys:  # Zenoh refuses a rule without keys
            messages[flow, tuple(keys)].append(message)
    return [
        {
            "id": f"{identity.name}-{number}",
            "permission": "allow",
            "flows": [flow],
            "messages": names,
            "key_exprs": list(keys),
        }
        for number, ((flow, keys), names) in enumerate(messages.items(), 1)
    ]


def _allow(out: Keys, access: Access, robot: str) -> None:
    def allow(flow: Flow, messages: tuple[str, ...], keys: tuple[str, ...]) -> None:
        for message in messages:
            out[flow, message].update(dict.fromkeys(keys))

    for topic in access.publishes:
        keys = topic.key(robot), *_of_cache(topic, robot)
        allow("ingress", ("put",), keys)
        allow("egress", ("declare_subscriber",), keys)
        cache = _of_cache(topic, robot)
        allow("ingress", ("declare_queryable", "liveliness_token"), cache)
        # The cache answers with the key of the message itself.
        allow("ingress", ("reply",), keys if cache else ())
        allow("egress", ("query", "liveliness_query", "declare_liveliness_subscriber"), cache)
    for topic in access.subscribes:
        keys = topic.key(robot), *_of_cache(topic, robot)
        allow("ingress", ("declare_subscriber",), keys)
        allow("egress", ("put",), keys)
        cache = _of_cache(topic, robot)
        seeking = ("query", "liveliness_query", "declare_liveliness_subscriber")
        allow("ingress", seeking, cache)
        allow("egress", ("reply",), keys if cache else ())
        allow("egress", ("declare_queryable", "liveliness_token"), cache)
    for method in access.serves:
        allow("ingress", ("declare_queryable", "reply"), (method.key(robot),))
        allow("egress", ("query",), (method.key(robot),))
    for method in access.calls:
        allow("ingress", ("query",), (method.key(robot),))
        allow("egress", ("reply", "declare_queryable"), (method.key(robot),))
    alive = f"{ROOT}/{robot}/alive"
    own = tuple(f"{alive}/{name}/*" for name in access.announces)
    # A service may ask for its own tokens: its health check does.
    allow("ingress", ("liveliness_token", "liveliness_query"), own)
    allow("egress", ("liveliness_token",), own)
    if access.watches:
        allow("ingress", ("liveliness_query", "declare_liveliness_subscriber"), (f"{alive}/*/*",))
        allow("egress", ("liveliness_token",), (f"{alive}/*/*",))


def _of_cache(topic: Topic, robot: str) -> tuple[str, ...]:
    """Keys of the store of the last message, which retained topics have."""
    return (f"{topic.key(robot)}/@adv/**",) if topic.qos is QoS.RETAINED else ()
