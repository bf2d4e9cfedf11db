"""Tests `deploy/router.json5`: which certificate may hear which topics and call which methods."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import trustme
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.topics import (
    METHODS,
    ROBOT_STATE,
    TOPICS,
    TRUTH_EPISODE,
    QoS,
    settings_method,
    status_topic,
)
from helios_core.zenoh_bus import ZenohBus

from tests.support import ENDS_WITHIN_S, free_port, wait_until

CONFIG = Path(__file__).parents[2] / "deploy" / "router.json5"
EVERY_TOPIC = (*TOPICS, status_topic("recorder"))
EVERY_METHOD = (*METHODS, settings_method("recorder"))
WITHIN_S = 20.0

Join = Callable[[str], ZenohBus]


@pytest.fixture(scope="module")
def endpoints(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """Endpoint by name of the client. The router runs with the deployed configuration."""
    folder, port = tmp_path_factory.mktemp("certificates"), free_port()
    authority = trustme.CA()
    authority.cert_pem.write_to_path(folder / "ca.pem")
    ends = {"nobody": f"tls/localhost:{port}#root_ca_certificate_file={folder}/ca.pem"}
    for who in ("router", "helios-service", "helios-simulation", "stranger"):
        made = authority.issue_cert("localhost", common_name=who)
        made.private_key_pem.write_to_path(folder / f"{who}.key")
        (folder / f"{who}.pem").write_bytes(b"".join(p.bytes() for p in made.cert_chain_pems))
        ends[who] = ends["nobody"] + (
            f";connect_certificate_file={folder}/{who}.pem"
            f";connect_private_key_file={folder}/{who}.key;enable_mtls=true"
        )
    text = CONFIG.read_text().replace("/etc/helios", str(folder))
    config = folder / "router.json5"
    config.write_text(text.replace("tls/0.0.0.0:7447", f"tls/127.0.0.1:{port}"))
    process = subprocess.Popen([sys.executable, "-m", "helios_core.router", "--config", config])
    yield ends
    process.terminate()
    assert process.wait(ENDS_WITHIN_S) == 0


@pytest.fixture
def join(endpoints: dict[str, str]) -> Iterator[Join]:
    made: list[ZenohBus] = []

    def opened(who: str) -> ZenohBus:
        def tried() -> bool:
            with suppress(Unavailable):
                made.append(ZenohBus(endpoints[who], "r"))
                return True
            return False

        wait_until(tried, WITHIN_S, f"{who} is let in")
        return made[-1]

    yield opened
    for bus in made:
        bus.close()


def test_a_service_certificate_may_hear_every_topic_and_call_every_method(join: Join) -> None:
    here, there = join("helios-service"), join("helios-service")
    heard: set[str] = set()
    for topic in EVERY_TOPIC:
        there.subscribe(topic, lambda _, name=topic.name: heard.add(name))
    names = {topic.name for topic in EVERY_TOPIC}

    def all_heard() -> bool:
        for topic in EVERY_TOPIC:
            here.publish(topic, topic.type())
        return heard == names

    wait_until(all_heard, WITHIN_S, "every topic is heard")
    late: set[str] = set()
    kept = {topic.name for topic in EVERY_TOPIC if topic.qos is QoS.RETAINED}
    newcomer = join("helios-service")
    for topic in EVERY_TOPIC:
        if topic.name in kept:
            newcomer.subscribe(topic, lambda _, name=topic.name: late.add(name))
    wait_until(lambda: late == kept, WITHIN_S, "a late joiner gets what is retained")
    alive: set[str] = set()
    there.watch(lambda service, *_: alive.add(service))
    here.announce("recorder", "one")
    wait_until(lambda: "recorder" in alive, WITHIN_S, "who lives is seen to live")
    for method in EVERY_METHOD:
        if not method.truth:
            here.serve(method, lambda _, method=method: method.reply())
            there.call(method, method.request(), WITHIN_S)


def test_only_the_simulation_certificate_may_call_truth_methods(join: Join) -> None:
    world, eyes, service = (
        join("helios-simulation"),
        join("helios-simulation"),
        join("helios-service"),
    )
    world.serve(TRUTH_EPISODE, lambda _: TRUTH_EPISODE.reply(seed=7))
    assert eyes.call(TRUTH_EPISODE, TRUTH_EPISODE.request(), WITHIN_S).seed == 7
    with pytest.raises(Unavailable):
        service.call(TRUTH_EPISODE, TRUTH_EPISODE.request(), 1.0)


def test_a_certificate_with_an_unknown_name_hears_nothing_and_reaches_nobody(join: Join) -> None:
    stranger, service, witness = join("stranger"), join("helios-service"), join("helios-service")
    overheard: list[pb.RobotState] = []
    heard: list[pb.RobotState] = []
    stranger.subscribe(ROBOT_STATE, overheard.append)
    witness.subscribe(ROBOT_STATE, heard.append)

    def said() -> bool:
        stranger.publish(ROBOT_STATE, ROBOT_STATE.type(message="stranger"))
        service.publish(ROBOT_STATE, ROBOT_STATE.type(message="service"))
        return len(heard) > 3

    wait_until(said, WITHIN_S, "the services hear one another")
    assert {state.message for state in heard} == {"service"}
    # The stranger's own message, within its process.
    assert {state.message for state in overheard} == {"stranger"}


def test_a_client_without_a_certificate_is_refused(endpoints: dict[str, str], join: Join) -> None:
    join("helios-service")  # waits until the router accepts connections
    with pytest.raises(Unavailable):
        ZenohBus(endpoints["nobody"], "r").call(TRUTH_EPISODE, TRUTH_EPISODE.request(), 1.0)
