"""Flags of `helios up`, checked and completed to the options of a stack."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from helios_core.router_link import listen_port

from helios_client.supervision import flag_checks, state_file
from helios_client.supervision.fleet_flags import chosen_services, fleet_names, router_endpoint
from helios_client.supervision.fleet_specs import FleetOptions
from helios_client.supervision.model_check import check_models
from helios_client.supervision.preset_defaults import preset_defaults
from helios_client.supervision.ros2_python import chosen_ros2_python
from helios_client.supervision.service_specs import LOOPBACK, StackOptions, free_port
from helios_client.usage_errors import UsageError

MODEL_VARIABLES = ("HELIOS_DETECTOR_MASKS", "HELIOS_DETECTOR_DEPTH")


@dataclass(frozen=True)
class UpFlags:
    """Flags of `helios up`, as given; None where the flag is missing."""

    robot: str
    port: int
    seed: int
    preset: str
    home: Path | None
    level: str | None
    furniture: str | None
    state: Path | None
    detector: str | None
    scorer: str | None
    agent: str | None
    source: Path | None
    rate: float
    record: bool
    record_dir: Path | None
    spot_host: str | None
    ros2: bool
    router_port: int | None
    router_host: str
    certs: Path | None
    name: str
    compact: bool
    services: str | None
    router: str | None
    robots: str | None
    tracing: bool = False
    log_format: str | None = None


def stack_options(given: UpFlags) -> StackOptions:
    """Options of the stack that the flags ask for. Raises UsageError or InvalidInput if one is
    wrong, names a model that is missing, or does not fit another."""
    robot = flag_checks.check_robot(given.robot)
    flag_checks.check_name(given.name)
    flag_checks.check_together(robot, vars(given))
    if given.source is not None:
        flag_checks.check_source(given.source)
    services = chosen_services(given.services, given.router)
    certs, router_port = _router(given)
    detector = flag_checks.check_detector(given.detector or _detector(robot, given, services))
    scorer = None if given.scorer is None else flag_checks.check_scorer(given.scorer, robot)
    check_models((detector, scorer, *map(os.environ.get, MODEL_VARIABLES)))
    agent = None if given.agent is None else flag_checks.check_agent(given.agent)
    preset, furniture = flag_checks.check_home(given.preset, given.furniture)
    plan_name, remarks = flag_checks.check_plan(preset, given.home, given.level)
    for remark in remarks:
        print(f"helios: {remark}", file=sys.stderr)
    of_preset = preset_defaults(
        robot, flag_checks.LIKE_PLANS if given.home else preset, detector, os.environ
    )
    state_dir = given.state or state_file.default_state_dir(given.port)
    recordings = given.record_dir or (state_dir / "recordings" if given.record else None)
    by_ros = given.ros2 or robot == "ros2"
    several = fleet_names(given.robots, robot, given.name)
    if several and given.compact:
        raise UsageError("--compact is for one robot; leave out --compact or --robots")
    kind = partial(FleetOptions, robots=several) if several else StackOptions
    return kind(
        robot=robot, router_port=router_port, state_dir=state_dir,
        name=several[0] if several else given.name,
        services=services,
        router_at="" if given.router is None else router_endpoint(given.router, certs),
        port=given.port, seed=given.seed, preset=preset, home=given.home and given.home.resolve(),
        level=given.level, home_name=plan_name, furniture=furniture, detector=detector,
        scorer=scorer, agent=agent, noise=of_preset.noise, max_steps=of_preset.max_steps,
        source=given.source, robot_host=given.spot_host,
        rate=given.rate if robot == "replay" else None, record=recordings,
        ros2_python=chosen_ros2_python(by_zenoh=not given.ros2) if by_ros else None,
        ros2_output=given.ros2, certs=certs, router_host=given.router_host,
        compact=given.compact, tracing=given.tracing,
        log_format=given.log_format and flag_checks.check_log_format(given.log_format),
    )  # fmt: skip


def _detector(robot: str, given: UpFlags, services: frozenset[str] | None) -> str:
    """Detector without --detector. Raises UsageError if this machine runs one and the user must
    name it."""
    if services is None or "detector" in services:
        return flag_checks.default_detector(robot, given.source)
    return "simulated"  # not started here


def _router(given: UpFlags) -> tuple[Path | None, int]:
    """Absolute folder of the certificates, and the port of the router; 0 for one elsewhere."""
    if given.router is not None:
        flag_checks.check_no_own_router(given.router_host, given.router_port)
        return given.certs and given.certs.absolute(), 0
    flag_checks.check_router(given.router_host, given.certs)
    if given.certs is None:
        return None, given.router_port or free_port(apart_from=given.port)
    certs = given.certs.absolute()
    listed_port = listen_port(certs)
    is_open = given.router_host != LOOPBACK
    own_port = listed_port if is_open else free_port(apart_from=given.port)
    return certs, given.router_port or own_port
