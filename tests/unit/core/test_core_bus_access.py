"""The table of rights on the bus: it names what the services' code names, and nothing else."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from helios_core import topics
from helios_core.access_control import Identity, access_control, allowed_keys
from helios_core.bus_access import ACCESS, SERVICES, SIMULATED_DETECTOR, Access, access_of
from helios_core.settings_spelling import SERVICES as WITH_SETTINGS
from helios_core.topics import (
    METHODS,
    TOPICS,
    Method,
    Topic,
    settings_method,
    spans_method,
    status_topic,
)
from hypothesis import given
from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[3]
# Code that runs in the process of each service, drivers included.
CODE = {
    "world": ("clients/helios_sim/service.py",),
    "bridge": (
        "services/helios_bridge",
        "clients/helios_sim/driver.py",
        "clients/helios_replay/driver.py",
        "clients/helios_spot",
    ),
    "detector": ("services/helios_detector", "clients/helios_replay/recorded_detector.py"),
    "objectmap": ("services/helios_objectmap",),
    "map2d": ("services/helios_map2d",),
    "planner": ("services/helios_planner",),
    "gateway": ("services/helios_gateway",),
    "supervisor": ("clients/helios_client/supervision",),
    "ros2": ("clients/helios_ros2/output_service.py", "clients/helios_ros2/task_interface.py"),
}
BY_NAME = {name: value for name, value in vars(topics).items() if isinstance(value, Topic | Method)}


def _named(path: Path) -> set[str]:
    """Names of topics and methods that a file uses, beyond its imports."""
    tree = ast.parse(path.read_text())
    return {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and n.id in BY_NAME}


def _in_code(service: str) -> set[str]:
    paths = [ROOT / path for path in CODE[service]]
    files = [f for p in paths for f in ([p] if p.is_file() else sorted(p.rglob("*.py")))]
    return {BY_NAME[name].name for file in files for name in _named(file)}


def _in_table(access: Access) -> set[str]:
    entries = (*access.publishes, *access.subscribes, *access.serves, *access.calls)
    of_each = (status_topic, settings_method, spans_method)
    derived = {of(service).name for of in of_each for service in SERVICES}
    return {entry.name for entry in entries} - derived


@pytest.mark.parametrize("service", CODE)
def test_the_table_names_exactly_the_topics_and_methods_of_the_code(service: str) -> None:
    assert _in_table(access_of(service, simulated=True)) == _in_code(service)


def test_each_topic_and_method_has_one_owner_and_a_user() -> None:
    senders = {t.name: [s for s, a in ACCESS.items() if t in a.publishes] for t in TOPICS}
    servers = {m.name: [s for s, a in ACCESS.items() if m in a.serves] for m in METHODS}
    assert all(senders.values())
    assert all(servers.values())
    for name, services in (senders | servers).items():
        assert name.partition("/")[0] in services
    # The simulated world and a robot of your own serve the same; a recording's detector and a
    # replay's driver repeat what others have sent.
    assert {name for name, services in servers.items() if len(services) > 1} == {
        m.name for m in METHODS if m in ACCESS["robot"].serves
    }
    repeated = {name: services for name, services in senders.items() if len(services) > 1}
    assert repeated == {
        "planner/context": ["bridge", "planner"],
        "map2d/ack": ["detector", "map2d"],
        "objectmap/ack": ["detector", "objectmap"],
    }


def test_only_the_evaluation_and_a_simulated_robots_detector_may_use_the_truth() -> None:
    callers = {name for name, a in ACCESS.items() if any(m.truth for m in a.calls)}
    assert callers == {"evaluation"}
    assert [m.name for m in SIMULATED_DETECTOR.calls if m.truth] == ["world/segmentation"]
    servers = {name for name, a in ACCESS.items() if any(m.truth for m in a.serves)}
    assert servers == {"world"}


def test_only_planner_gateway_and_programs_may_move_the_robot() -> None:
    movers = {name for name, a in ACCESS.items() if topics.ACT in a.calls}
    assert movers == {"planner", "gateway", "program"}
    stoppers = {name for name, a in ACCESS.items() if topics.STOP in a.calls}
    assert stoppers == {"planner", "gateway", "ros2", "program", "operator", "evaluation"}


def test_the_table_has_every_service_with_settings() -> None:
    # `replay` runs as the detector, and `spot` in the bridge.
    assert set(WITH_SETTINGS) - {"replay", "spot"} == set(SERVICES)
    assert set(SERVICES) < set(ACCESS)


robots = st.lists(st.sampled_from(["a", "b", "c"]), min_size=1, unique=True).map(tuple)
identities = st.builds(
    lambda service, robots: Identity(f"{service}.{robots[0]}", service, robots),
    st.sampled_from(sorted(ACCESS)),
    robots,
)


def _keys(identity: Identity) -> Iterator[str]:
    for keys in allowed_keys(identity).values():
        yield from keys


@given(identities)
def test_no_certificate_reaches_a_key_of_another_robot(identity: Identity) -> None:
    fleet = ("_detectors",) if identity.service == "detector" else ()
    for key in _keys(identity):
        assert key.split("/")[2] in (*identity.robots, *fleet)
        assert "**" not in key.removesuffix("/@adv/**")


@given(st.lists(identities, max_size=6, unique_by=lambda i: i.name))
def test_rules_deny_by_default_and_each_belongs_to_one_certificate(given: list[Identity]) -> None:
    access = access_control(given)
    assert access["default_permission"] == "deny"
    assert {rule["permission"] for rule in access["rules"]} <= {"allow"}
    assert all(rule["key_exprs"] and rule["messages"] for rule in access["rules"])
    used = [id for policy in access["policies"] for id in policy["rules"]]
    assert sorted(used) == sorted({rule["id"] for rule in access["rules"]})
    assert [p["subjects"] for p in access["policies"]] == [[i.name] for i in given]
    assert not any("delete" in rule["messages"] for rule in access["rules"])
