"""The options of `helios up`, checked before anything is started."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from helios_client.commands.shared_options import Port, State

if TYPE_CHECKING:
    from helios_client.supervision.service_specs import ServiceSpecs


@dataclass(frozen=True)
class UpOptions:
    """As typed; None is the default that the help names."""

    robot: Annotated[str, typer.Option(help="sim, replay, spot, bus, push or package:Class")] = (
        "sim"
    )
    port: Port = 8080
    seed: Annotated[int, typer.Option(help="of the simulated home", min=0)] = 0
    preset: Annotated[str, typer.Option(help="kind of the simulated home")] = "demo-v1"
    furniture: Annotated[
        str | None,
        typer.Option(help="of the simulated home: parametric or realistic (helios assets bake)"),
    ] = None
    state: State = None
    detector: Annotated[
        str | None,
        typer.Option(
            help="simulated, ground-truth, onnx:FILE, package:Class or another of "
            "docs/how-to/models.md  "
            "[default: simulated for sim]"
        ),
    ] = None
    scorer: Annotated[
        str | None,
        typer.Option(
            help="scores images against prompts: lexical, minilm, transformers:ID or "
            "package:Class  [default: its setting]"
        ),
    ] = None
    agent: Annotated[
        str | None,
        typer.Option(
            help="who decides, and what its maps take for true; or package:agent  [default: helios]"
        ),
    ] = None
    source: Annotated[
        Path | None, typer.Option(help="what --robot replay plays: a recording or data set")
    ] = None
    rate: Annotated[
        float, typer.Option(help="speed of --robot replay; 0: without waiting", min=0)
    ] = 1.0
    record: Annotated[
        bool, typer.Option("--record", help="record every topic", envvar="HELIOS_RECORD")
    ] = False
    record_dir: Annotated[
        Path | None, typer.Option(help="folder of the recordings  [default: STATE/recordings]")
    ] = None
    spot_host: Annotated[
        str | None, typer.Option(help="of --robot spot; login: HELIOS_SPOT_USERNAME, …_PASSWORD")
    ] = None
    router_port: Annotated[
        int | None, typer.Option(help="port of the router  [default: a free one]", min=1, max=65535)
    ] = None
    name: Annotated[str, typer.Option(help="the robot's name on the bus")] = "robot"

    def checked(self) -> ServiceSpecs:
        """The processes to start. Raises UsageError for what cannot work or does not go together.

        It imports late: a command that starts nothing should not wait for what this needs.
        """
        from helios_client.replay.input_selection import check_source, default_detector
        from helios_client.supervision import flag_checks, state_file
        from helios_client.supervision.service_specs import ServiceSpecs, free_port

        robot = flag_checks.check_robot(self.robot)
        _check_name(self.name)
        self._check_go_with(robot)
        detector = self.detector
        if detector is None:
            detector = default_detector(robot, self.source)
        detector = flag_checks.check_detector(detector)
        scorer = None if self.scorer is None else flag_checks.check_scorer(self.scorer)
        agent = None if self.agent is None else flag_checks.check_agent(self.agent)
        preset, furniture = flag_checks.check_home(robot, self.preset, self.furniture)
        if self.source is not None:
            check_source(self.source)
        state_dir = self.state or state_file.default_state_dir(self.port)
        record_dir = self.record_dir
        if self.record and record_dir is None:
            record_dir = state_dir / "recordings"
        return ServiceSpecs(
            robot=robot, router_port=self.router_port or free_port(),
            state_dir=state_dir, name=self.name, port=self.port, seed=self.seed,
            preset=preset, furniture=furniture, detector=detector, scorer=scorer, agent=agent,
            source=self.source, robot_host=self.spot_host,
            rate=self.rate if robot == "replay" else None, record=record_dir,
        )  # fmt: skip

    def _check_go_with(self, robot: str) -> None:
        """Whether the options of one kind of robot are given with that robot. Raises UsageError."""
        from helios_client.usage_errors import UsageError

        if self.spot_host is not None and robot != "spot":
            raise UsageError("--spot-host goes with --robot spot, and only with it")
        if robot == "replay" and self.source is None:
            raise UsageError("--robot replay needs --source, the recording or data set to play")
        if self.source is not None and robot != "replay":
            raise UsageError("--source goes with --robot replay, and only with it")


def _check_name(name: str) -> None:
    from helios_core.errors import InvalidInput
    from helios_core.name_rules import robot_name

    from helios_client.usage_errors import UsageError

    try:
        robot_name(name)
    except InvalidInput as error:
        raise UsageError(f"--name: {error.message}") from error
