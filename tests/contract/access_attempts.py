"""Attempts of every certificate at every operation on every key, and what came through.

Each function returns the set of (certificate, operation, key) that the router let through. A mark
behind the attempts of each session tells when all of them have been handled, since a link keeps
the order of its messages.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import zenoh
from helios_core.access_control import Identity
from helios_core.bus_access import FLEET, FLEET_BUS, FLEET_TOKEN, SERVICES, Access, access_of
from helios_core.topics import (
    ANY_STATUS,
    METHODS,
    ROOT,
    TOPICS,
    QoS,
    Topic,
    alive_key,
    settings_method,
    spans_method,
    status_topic,
)

from tests.support import wait_until

Attempt = tuple[str, str, str]  # certificate, operation, key
Sessions = Mapping[str, zenoh.Session]
WITHIN_S = 60.0
EVERY_TOPIC = (*TOPICS, *(status_topic(name) for name in SERVICES))
OF_EACH = (settings_method, spans_method)
EVERY_METHOD = (*METHODS, *(of(name) for of in OF_EACH for name in SERVICES))
EVERY_TOKEN = (*SERVICES, "supervisor", "robot", "operator", FLEET_TOKEN)
# Wider keys: nobody may use one to reach more than the keys of the table.
WILD = ("**", f"{ROOT}/**", f"{ROOT}/*/svc/**", f"{ROOT}/*/*/*", f"{ROOT}/*/truth/**")


@dataclass(frozen=True)
class Targets:
    """All keys of some robots."""

    topics: tuple[str, ...]
    caches: tuple[str, ...]  # of retained topics: key of one publisher's store
    methods: tuple[str, ...]
    tokens: tuple[str, ...]

    @staticmethod
    def of(robots: Iterable[str]) -> Targets:
        names = tuple(robots)
        return Targets(
            tuple(t.key(r) for r in names for t in EVERY_TOPIC),
            tuple(key for r in names for key in _caches(EVERY_TOPIC, r)),
            tuple(m.key(r) for r in names for m in EVERY_METHOD),
            tuple(alive_key(r, service, "x") for r in names for service in EVERY_TOKEN),
        )


def allowed_attempts(identities: Iterable[Identity], simulated: Iterable[str]) -> set[Attempt]:
    """What the table allows; simulated: robots whose world is simulated."""
    out: set[Attempt] = set()
    truth = set(simulated)
    for identity in identities:
        for robot in identity.robots:
            access = access_of(identity.service, simulated=robot in truth)
            out |= _allowed(identity.name, access, robot)
        if identity.service == "detector":
            out |= _allowed(identity.name, FLEET, FLEET_BUS)
    return out


def _allowed(name: str, access: Access, robot: str) -> set[Attempt]:
    heard_topics = [t for t in access.subscribes if t != ANY_STATUS]
    if ANY_STATUS in access.subscribes:
        heard_topics += [status_topic(name) for name in SERVICES]
    sent, got = _caches(access.publishes, robot), _caches(heard_topics, robot)
    own = [alive_key(robot, s, "x") for s in access.announces]
    of = {
        "put": (*(t.key(robot) for t in access.publishes), *sent),
        "subscribe": (*(t.key(robot) for t in heard_topics), *got),
        "serve": (*(m.key(robot) for m in access.serves), *sent),
        "call": (*(m.key(robot) for m in access.calls), *got),
        "announce": (*own, *sent),
        "watch": (*own, *got),
    }
    if access.watches:
        of["watch"] = (*got, *(alive_key(robot, s, "x") for s in EVERY_TOKEN))
    return {(name, operation, key) for operation, keys in of.items() for key in keys}


def _caches(topics: Iterable[Topic], robot: str) -> tuple[str, ...]:
    """Key of one publisher's store of each retained topic."""
    return tuple(f"{t.key(robot)}/@adv/pub/00/1/_" for t in topics if t.qos is QoS.RETAINED)


def all_attempts(identities: Iterable[Identity], targets: Targets) -> set[Attempt]:
    """Every pair of certificate and operation that the functions below try, without wide keys."""
    data, answers = (*targets.topics, *targets.caches), (*targets.methods, *targets.caches)
    everything = (*data, *targets.methods)
    tokens = (*targets.tokens, *targets.caches)
    of = {
        "put": everything,
        "delete": everything,
        "subscribe": data,
        "serve": answers,
        "call": answers,
        "announce": tokens,
        "watch": tokens,
    }
    return {
        (i.name, operation, key) for i in identities for operation in of for key in of[operation]
    }


def published(witness: zenoh.Session, sessions: Sessions, targets: Targets) -> set[Attempt]:
    """Puts and deletes that reach a subscriber of everything."""
    through: set[Attempt] = set()
    done: set[str] = set()

    def hear(sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if key.startswith("test/"):
            done.add(key.removeprefix("test/"))
            return
        attached = sample.attachment
        who = attached.to_string() if attached is not None else "?"
        kind = "put" if sample.kind == zenoh.SampleKind.PUT else "delete"
        through.add((who, kind, key))

    keys = (*targets.topics, *targets.caches, *targets.methods)
    hearing = [  # each key too: a peer sends only what it sees wanted, and may not see wider keys
        witness.declare_subscriber(key, zenoh.handlers.Callback(hear))
        for key in ("**", "**/@adv/**", "test/*", *keys)
    ]
    for name, session in sessions.items():
        for key in (*keys, *WILD):
            session.put(
                key, b"x", attachment=name, congestion_control=zenoh.CongestionControl.BLOCK
            )
            session.delete(key, attachment=name, congestion_control=zenoh.CongestionControl.BLOCK)
        session.put(f"test/{name}", b"", congestion_control=zenoh.CongestionControl.BLOCK)
    wait_until(lambda: done == set(sessions), WITHIN_S, "all puts have been handled")
    for one in hearing:
        one.undeclare()
    return through


def heard(witness: zenoh.Session, sessions: Sessions, targets: Targets) -> set[Attempt]:
    """Messages that reach the certificates, each subscribed to every key, also to wide ones."""
    through: set[Attempt] = set()
    declared = []

    def hearer(name: str) -> Callable[[zenoh.Sample], None]:
        return lambda sample: through.add((name, "subscribe", str(sample.key_expr)))

    def hear_all(mark: str) -> bool:
        witness.put(mark, b"", congestion_control=zenoh.CongestionControl.BLOCK)
        return all((name, "subscribe", mark) in through for name in sessions)

    keys = (*targets.topics, *targets.caches)
    for name, session in sessions.items():
        handler = hearer(name)
        for key in (*keys, *targets.methods, *WILD, "**/@adv/**", "test/declared", "test/heard"):
            declared.append(session.declare_subscriber(key, zenoh.handlers.Callback(handler)))
    wait_until(lambda: hear_all("test/declared"), WITHIN_S, "all subscriptions have been handled")
    for key in (*keys, *targets.methods):
        witness.put(key, b"x", congestion_control=zenoh.CongestionControl.BLOCK)
    wait_until(lambda: hear_all("test/heard"), WITHIN_S, "everyone has heard the mark")
    for one in declared:
        one.undeclare()
    return {attempt for attempt in through if not attempt[2].startswith("test/")}


def called(witness: zenoh.Session, sessions: Sessions, targets: Targets) -> set[Attempt]:
    """Queries that reach a server of everything. Fails if an allowed one gets no reply."""
    through: set[Attempt] = set()
    lock = threading.Lock()

    def serve(query: zenoh.Query) -> None:
        with query:
            key, payload = str(query.key_expr), query.payload
            with lock:
                through.add((payload.to_string() if payload is not None else "?", "call", key))
            if "*" not in key:
                query.reply(key, b"answer")

    serving = [
        witness.declare_queryable(key, zenoh.handlers.Callback(serve))
        for key in ("**", "**/@adv/**", "test/called", *targets.methods, *targets.caches)
    ]
    replied: set[Attempt] = set()
    for name, session in sessions.items():
        wait_until(lambda s=session: _ask(s, "test/called", "?"), WITHIN_S, f"{name} gets answers")
        asked = [
            (key, session.get(key, zenoh.handlers.FifoChannel(64), payload=name, timeout=10))
            for key in (*targets.methods, *targets.caches, *targets.topics, *WILD)
        ]
        for key, replies in asked:
            if any(reply.ok is not None for reply in replies):
                replied.add((name, "call", key))
    for one in serving:
        one.undeclare()
    through = {attempt for attempt in through if not attempt[2].startswith("test/")}
    assert replied == through
    return through


def served(witness: zenoh.Session, sessions: Sessions, targets: Targets) -> set[Attempt]:
    """Answers that reach a caller, with every certificate serving every key, also wide ones."""
    declared = []

    def server(name: str) -> Callable[[zenoh.Query], None]:
        def serve(query: zenoh.Query) -> None:
            with query:
                query.reply(query.key_expr, name)

        return serve

    keys = (*targets.methods, *targets.caches)
    for name, session in sessions.items():
        for key in (*keys, *WILD, "**/@adv/**", f"test/served/{name}"):
            handler = zenoh.handlers.Callback(server(name))
            declared.append(session.declare_queryable(key, handler))
        mark = f"test/served/{name}"
        wait_until(lambda m=mark: _ask(witness, m, ""), WITHIN_S, f"{name} serves")
    through: set[Attempt] = set()
    for key in keys:
        replies = witness.get(
            key,
            zenoh.handlers.FifoChannel(64),
            timeout=10,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        through |= {(r.ok.payload.to_string(), "serve", key) for r in replies if r.ok is not None}
    for one in declared:
        one.undeclare()
    return through


def announced(witness: zenoh.Session, sessions: Sessions, targets: Targets) -> set[Attempt]:
    """Liveliness tokens that a watcher of everything sees, of each certificate in turn."""
    through: set[Attempt] = set()
    for name, session in sessions.items():
        keys = (*targets.tokens, *targets.caches, f"test/token/{name}")
        tokens = [session.liveliness().declare_token(key) for key in keys]
        mark = f"test/token/{name}"
        wait_until(lambda m=mark: m in _tokens(witness, m), WITHIN_S, f"{name} is alive")
        seen = _tokens(witness, "**") | _tokens(witness, "**/@adv/**")
        through |= {(name, "announce", key) for key in seen if not key.startswith("test/")}
        for token in tokens:
            token.undeclare()
        gone = f"tokens of {name} are gone"
        wait_until(lambda m=mark: m not in _tokens(witness, m), WITHIN_S, gone)
    return through


def watched(witness: zenoh.Session, sessions: Sessions, targets: Targets) -> set[Attempt]:
    """Liveliness tokens that each certificate sees, by query and by subscription."""
    through: set[Attempt] = set()
    tokens = (*targets.tokens, *targets.caches, "test/alive")
    declared = [witness.liveliness().declare_token(key) for key in tokens]
    for name, session in sessions.items():
        mark = "the mark is seen"
        wait_until(lambda s=session: "test/alive" in _tokens(s, "test/alive"), WITHIN_S, mark)
        for key in (*(t for t in tokens), *WILD, f"{ROOT}/*/alive/*/*", "**/@adv/**"):
            through |= {(name, "watch", seen) for seen in _tokens(session, key)}
        seen: set[str] = set()
        hear = zenoh.handlers.Callback(_adder(seen))
        watching = [
            session.liveliness().declare_subscriber(key, hear, history=True)
            for key in (*tokens, *WILD, f"{ROOT}/*/alive/*/*", "**/@adv/**")
        ]
        wait_until(lambda s=seen: "test/alive" in s, WITHIN_S, mark)
        through |= {(name, "watch", key) for key in seen}
        for one in watching:
            one.undeclare()
    for token in declared:
        token.undeclare()
    return {attempt for attempt in through if not attempt[2].startswith("test/")}


def _adder(seen: set[str]) -> Callable[[zenoh.Sample], None]:
    return lambda sample: seen.add(str(sample.key_expr))


def _ask(session: zenoh.Session, key: str, payload: str) -> bool:
    replies = session.get(key, zenoh.handlers.FifoChannel(8), payload=payload, timeout=10)
    return any(reply.ok is not None for reply in replies)


def _tokens(session: zenoh.Session, key: str) -> set[str]:
    replies = session.liveliness().get(key, zenoh.handlers.FifoChannel(1024), timeout=10)
    return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
