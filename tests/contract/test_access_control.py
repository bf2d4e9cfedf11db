"""Tests a router under generated access rules: who gets what through, and who is let in."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from helios_client.certs.authority import new_authority, new_client, new_router
from helios_client.certs.folder import credentials_of
from helios_client.certs.names import Names
from helios_core.bus_access import FLEET_BUS
from helios_core.errors import Unavailable
from helios_core.router_link import ROUTER_FILE, SESSIONS, RouterLink
from helios_core.topics import EMBED_TEXT, GET_STATE, ROBOT_STATE, STOP, alive_key
from helios_core.zenoh_bus import ZenohBus
from helios_core.zenoh_config import client_config, router_values

from tests.contract import access_attempts as attempts
from tests.contract.access_attempts import Attempt, Sessions, Targets
from tests.contract.certified_router import (
    WITNESS,
    Certified,
    authority_of,
    certified_router,
    write_session,
)
from tests.support import free_port, wait_until

ROOT = Path(__file__).parents[2]
NAMES = (
    Names(("127.0.0.1",), 7447, 5)
    .with_robots(("r",), (), simulated=True)
    .with_robots(("other",), (), simulated=False)
    .with_people(("ann",), ("drive",))
)
TARGETS = Targets.of(("r", "other", FLEET_BUS))
ALLOWED = attempts.allowed_attempts(NAMES.identities, ("r",))
ALL = attempts.all_attempts(NAMES.identities, TARGETS)
NOW = dt.datetime.now(dt.UTC)

Through = Callable[[zenoh.Session, Sessions, Targets], set[Attempt]]


@pytest.fixture(scope="module")
def router(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Certified]:
    with certified_router(tmp_path_factory.mktemp("made") / "certs", NAMES) as router:
        yield router


@pytest.fixture(scope="module")
def witness(router: Certified) -> Iterator[zenoh.Session]:
    with router.session(WITNESS) as session:
        yield session


@pytest.fixture(scope="module")
def sessions(router: Certified) -> Iterator[dict[str, zenoh.Session]]:
    """A session for each certificate."""
    out = {identity.name: router.session(identity.name) for identity in NAMES.identities}
    yield out
    for session in out.values():
        session.close()


def test_the_attempts_cover_what_the_table_allows_and_far_more() -> None:
    assert ALLOWED < ALL
    assert len(ALL - ALLOWED) > 20_000
    page = " ".join((ROOT / "docs/explanation/security.md").read_text().split())
    said = (
        f"Of {len(ALL):,} pairs of certificate and operation the table allows {len(ALLOWED):,}, "
        f"and exactly these come through. All {len(ALL - ALLOWED):,} others are refused."
    )
    assert said in page, f"docs/explanation/security.md should say: {said}"


@pytest.mark.parametrize(
    ("through", "operations"),
    [
        (attempts.published, {"put", "delete"}),
        (attempts.heard, {"subscribe"}),
        (attempts.called, {"call"}),
        (attempts.served, {"serve"}),
        (attempts.announced, {"announce"}),
        (attempts.watched, {"watch"}),
    ],
    ids=["put", "subscribe", "call", "serve", "announce", "watch"],
)
def test_exactly_what_the_table_allows_comes_through(
    witness: zenoh.Session, sessions: Sessions, through: Through, operations: set[str]
) -> None:
    got = through(witness, sessions, TARGETS)
    assert got - ALLOWED == set()
    assert {attempt for attempt in ALLOWED if attempt[1] in operations} - got == set()


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_a_client_that_calls_itself_a_router_has_no_more_rights(
    router: Certified, witness: zenoh.Session, mode: str
) -> None:
    config = client_config(router.link("map2d.r"))
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("listen/endpoints", "[]")
    with zenoh.open(config) as session:
        only = {"map2d.r": session}
        own = {attempt for attempt in ALLOWED if attempt[0] == "map2d.r"}
        assert attempts.published(witness, only, TARGETS) - own == set()
        assert attempts.heard(witness, only, TARGETS) - own == set()
        assert attempts.called(witness, only, TARGETS) - own == set()
        assert attempts.served(witness, only, TARGETS) - own == set()
        assert attempts.announced(witness, only, TARGETS) - own == set()
        assert attempts.watched(witness, only, TARGETS) - own == set()


def is_used(declared: zenoh.Querier | zenoh.Publisher) -> bool:
    """Return whether a session sees anyone at the other end. (The stubs say bool.)"""
    status: Any = declared.matching_status
    return status.matching


def test_nobody_learns_whether_a_forbidden_key_is_in_use(
    witness: zenoh.Session, router: Certified
) -> None:
    """eclipse-zenoh/zenoh 1562: declarations were seen past an access control list."""
    keys = STOP.key("r"), EMBED_TEXT.key("r")
    hear = zenoh.handlers.Callback(lambda _: None)
    serving = [witness.declare_queryable(key, hear) for key in keys]
    hearing = witness.declare_subscriber(ROBOT_STATE.key("r"), hear)
    with router.session("map2d.r") as session:
        forbidden, allowed = (session.declare_querier(key) for key in keys)
        publisher = session.declare_publisher(ROBOT_STATE.key("r"))
        wait_until(lambda: is_used(allowed), 60, "the allowed server is seen")
        assert not is_used(forbidden)
        assert not is_used(publisher)
    for one in (*serving, hearing):
        one.undeclare()


def test_the_router_describes_itself_to_nobody(sessions: Sessions) -> None:
    for session in sessions.values():
        replies = session.get("@/**", zenoh.handlers.FifoChannel(64), timeout=10)
        keys = {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
        assert {key for key in keys if not key.startswith(f"@/{session.zid()}/")} == set()


def test_a_late_service_gets_the_last_retained_message(router: Certified) -> None:
    bridge = ZenohBus(router.link("bridge.r"), "r")
    bridge.publish(ROBOT_STATE, ROBOT_STATE.type(message="hello"))
    late: list[str] = []
    map2d = ZenohBus(router.link("map2d.r"), "r")
    map2d.subscribe(ROBOT_STATE, lambda state: late.append(state.message))
    wait_until(lambda: late == ["hello"], 60, "the last state arrives")
    for bus in (bridge, map2d):
        bus.close()


# --- who is let in --------------------------------------------------------------------------------
def refused(link: RouterLink) -> bool:
    """Return whether no session can be opened."""
    try:
        zenoh.open(client_config(link)).close()
    except zenoh.ZError:
        return True
    return False


def test_without_a_certificate_nobody_is_let_in(router: Certified) -> None:
    with pytest.raises(Unavailable):
        ZenohBus(f"tcp/127.0.0.1:{router.port}", "r")
    config = json.loads((router.folder / SESSIONS / "map2d.r.json5").read_text())
    tls = config["transport"]["link"]["tls"]
    for field in ("connect_certificate_base64", "connect_private_key_base64", "enable_mtls"):
        del tls[field]
    config["connect"]["endpoints"] = [router.endpoint]
    with pytest.raises(zenoh.ZError), zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as s:
        list(s.get(GET_STATE.key("r"), zenoh.handlers.FifoChannel(1), timeout=5))


@pytest.mark.parametrize("fault", ["another authority", "expired", "the router's"])
def test_a_wrong_certificate_opens_nothing(
    router: Certified, witness: zenoh.Session, fault: str
) -> None:
    authority = authority_of(router.folder)
    long_ago = NOW - dt.timedelta(days=9)
    own = {
        "another authority": lambda: new_client(new_authority(9, NOW), "bridge.r", 9, NOW),
        "expired": lambda: new_client(authority, "bridge.r", 1, long_ago),
        "the router's": lambda: new_router(authority, "bridge.r", ("localhost",), 9, NOW),
    }[fault]()
    write_session(router.folder, "wrong", authority, own)
    came: list[zenoh.Sample] = []
    key = ROBOT_STATE.key("r")
    hearing = witness.declare_subscriber(key, zenoh.handlers.Callback(came.append))
    try:
        # TLS 1.3 tells the client of the refusal only after its handshake: it may seem open.
        with router.session("wrong") as session:
            session.put(key, b"x")
    except zenoh.ZError:
        pass
    with router.session("bridge.r") as session:
        session.put(key, b"good")
    wait_until(lambda: came, 60, "the right certificate works")
    assert [sample.payload.to_string() for sample in came] == ["good"]
    hearing.undeclare()


def test_a_renewed_name_keeps_its_old_certificate_until_that_expires(router: Certified) -> None:
    """Zenoh has no revocation list; the security page says what to do."""
    authority = authority_of(router.folder)
    for name in ("stolen", "renewed"):
        write_session(router.folder, name, authority, new_client(authority, "bridge.r", 9, NOW))
    assert not refused(router.link("stolen"))
    assert not refused(router.link("renewed"))


def test_the_router_reads_the_access_list_at_its_start_alone(
    router: Certified, witness: zenoh.Session
) -> None:
    file = router.folder / ROUTER_FILE
    rules = file.read_text()
    closed = json.loads(rules)
    closed["access_control"]["rules"] = []
    closed["access_control"]["policies"] = []
    heard: list[zenoh.Sample] = []
    hearing = witness.declare_subscriber(
        ROBOT_STATE.key("r"), zenoh.handlers.Callback(heard.append)
    )
    file.write_text(json.dumps(closed))
    try:
        with router.session("bridge.r") as session:
            session.put(ROBOT_STATE.key("r"), b"still allowed")
            wait_until(lambda: heard, 60, "the bridge is heard")
    finally:
        file.write_text(rules)
        hearing.undeclare()


def test_a_name_without_rules_may_do_nothing(router: Certified, witness: zenoh.Session) -> None:
    authority = authority_of(router.folder)
    write_session(router.folder, "stranger", authority, new_client(authority, "stranger", 9, NOW))
    heard: list[zenoh.Sample] = []
    got: list[object] = []
    hear = zenoh.handlers.Callback(heard.append)
    hearing = witness.declare_subscriber(ROBOT_STATE.key("r"), hear)
    get_state, alive = GET_STATE.key("r"), alive_key("r", "planner", "1")

    def answer(query: zenoh.Query) -> None:
        query.reply(get_state, b"bridge")

    with router.session("bridge.r") as bridge, router.session("stranger") as stranger:
        serving = bridge.declare_queryable(get_state, zenoh.handlers.Callback(answer))
        wait_until(lambda: replies_to(witness, get_state) == ["bridge"], 60, "the bridge serves")
        stranger.put(ROBOT_STATE.key("r"), b"stranger")
        assert replies_to(stranger, get_state) == []
        stranger.declare_subscriber("**", zenoh.handlers.Callback(got.append))
        stranger.declare_queryable("**", zenoh.handlers.Callback(got.append))
        stranger.liveliness().declare_token(alive)
        assert replies_to(witness, get_state) == ["bridge"]
        bridge.put(ROBOT_STATE.key("r"), b"bridge")
        wait_until(lambda: heard, 60, "the bridge is heard")
        tokens = witness.liveliness().get("**", zenoh.handlers.FifoChannel(64), timeout=10)
        assert alive not in [str(t.ok.key_expr) for t in tokens if t.ok is not None]
        serving.undeclare()
    assert [sample.payload.to_string() for sample in heard] == ["bridge"]
    assert got == []
    hearing.undeclare()


def replies_to(session: zenoh.Session, key: str) -> list[str]:
    """Answers to a query with every server of a key."""
    found = session.get(
        key, zenoh.handlers.FifoChannel(8), timeout=10, target=zenoh.QueryTarget.ALL
    )
    return [reply.ok.payload.to_string() for reply in found if reply.ok is not None]


def test_a_client_cannot_pretend_to_be_the_router(router: Certified) -> None:
    """Whoever has a client's key may listen, but the other clients see that it is no router."""
    stolen = credentials_of(router.folder / SESSIONS / "map2d.r.json5")
    port = free_port()
    listen = [f"tls/127.0.0.1:{port}"]
    with zenoh.open(zenoh.Config.from_json5(json.dumps(router_values(listen, stolen)))):
        assert refused(RouterLink(listen[0], router.folder / SESSIONS / "bridge.r.json5"))
    assert not refused(router.link("bridge.r"))


def test_the_router_is_known_by_its_addresses_only(router: Certified) -> None:
    wrong = RouterLink(f"tls/127.0.0.2:{router.port}", router.link("bridge.r").session)
    assert refused(wrong)
