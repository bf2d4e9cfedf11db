"""Commands that start services: `helios up`, `record`, `replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from helios_client.commands.shared_options import Certs, Port, State, TypedPort, Url, console

app = typer.Typer()
LOOPBACK = "127.0.0.1"


RobotKind = Annotated[
    str,
    typer.Option(
        help="driver: sim, replay, spot, ros2, bus, push or package:Class; remote: it runs on "
        "another machine"
    ),
]
Seed = Annotated[int, typer.Option(help="seed of the simulated home", min=0)]
Preset = Annotated[str, typer.Option(help="preset of the simulated home")]
Home = Annotated[
    Path | None,
    typer.Option(help="home of --robot sim that you drew in Sweet Home 3D, a .sh3d file"),
]
Level = Annotated[
    str | None, typer.Option(help="level of --home  [default: the one with the most rooms]")
]
Furniture = Annotated[
    str | None,
    typer.Option(
        help="furniture of the simulated home: parametric or realistic (helios assets bake)"
    ),
]
Detector = Annotated[
    str | None,
    typer.Option(
        help="detector: simulated, ground-truth, onnx:FILE, package:Class or another of "
        "docs/how-to/models.md  "
        "[default: simulated for sim]"
    ),
]
Scorer = Annotated[
    str | None,
    typer.Option(
        help="image-text scorer: lexical, minilm, transformers:ID or package:Class; with the "
        "simulator also simulated or simulated:TABLE  [default: the detector's setting]"
    ),
]
Agent = Annotated[
    str | None,
    typer.Option(
        help="agent of the planner and the object map, or package:agent  [default: helios]"
    ),
]
Source = Annotated[
    Path | None, typer.Option(help="recording or data set that --robot replay plays")
]
Rate = Annotated[float, typer.Option(help="speed of --robot replay; 0: without waiting", min=0)]
Record = Annotated[
    bool, typer.Option("--record", help="record every topic", envvar="HELIOS_RECORD")
]
RecordDir = Annotated[
    Path | None, typer.Option(help="folder for the recordings  [default: STATE/recordings]")
]
SpotHost = Annotated[
    str | None, typer.Option(help="host of --robot spot; login: HELIOS_SPOT_USERNAME, …_PASSWORD")
]
Ros2Output = Annotated[
    bool, typer.Option("--ros2", help="publish maps, objects and tasks to ROS 2")
]
RouterPort = Annotated[
    int | None,
    typer.Option(
        help="port of the router  [default: a free one; open to other machines: that of --certs]",
        min=1,
        max=65535,
    ),
]
RouterHost = Annotated[
    str,
    typer.Option(help="address that the router listens on; 0.0.0.0: for other machines, too"),
]
Compact = Annotated[
    bool,
    typer.Option("--compact", help="all services in one process, for computers with little memory"),
]
Tracing = Annotated[
    bool,
    typer.Option("--tracing", help="record spans for helios why TASK --trace (extra: tracing)"),
]
LogForm = Annotated[
    str | None,
    typer.Option("--log-format", help="form of the services' logs: text or json  [default: text]"),
]
BusName = Annotated[str, typer.Option(help="name of the robot on the bus")]
Services = Annotated[
    str | None,
    typer.Option(
        help="services of this machine, such as planner,objectmap  [default: all; with --router "
        "all but router and gateway]"
    ),
]
RouterElsewhere = Annotated[
    str | None,
    typer.Option(help="router on another machine, HOST or HOST:PORT  [default: one starts here]"),
]
Robots = Annotated[
    str | None,
    typer.Option(
        help="several robots at one gateway: their number, or their names separated by commas; "
        "for --robot sim, which gives each the home of the next seed, and remote"
    ),
]


@app.command()
def up(
    robot: RobotKind = "sim",
    port: Port = 8080,
    seed: Seed = 0,
    preset: Preset = "demo-v1",
    home: Home = None,
    level: Level = None,
    furniture: Furniture = None,
    state: State = None,
    detector: Detector = None,
    scorer: Scorer = None,
    agent: Agent = None,
    source: Source = None,
    rate: Rate = 1.0,
    record: Record = False,
    record_dir: RecordDir = None,
    spot_host: SpotHost = None,
    ros2: Ros2Output = False,
    router_port: RouterPort = None,
    router_host: RouterHost = LOOPBACK,
    certs: Certs = None,
    name: BusName = "robot",
    compact: Compact = False,
    tracing: Tracing = False,
    log_format: LogForm = None,
    services: Services = None,
    router: RouterElsewhere = None,
    robots: Robots = None,
) -> None:
    """Run all services on this machine until Ctrl-C."""
    from helios_client.supervision.forked_process import fork_server_for

    with fork_server_for(several=not compact) as server:  # first: it imports meanwhile
        from helios_client.supervision.up import Screen
        from helios_client.supervision.up import up as run_up
        from helios_client.supervision.up_flags import UpFlags, stack_options

        stack = stack_options(
            UpFlags(
                robot=robot, port=port, seed=seed, preset=preset, home=home, level=level,
                furniture=furniture, state=state, detector=detector, scorer=scorer, agent=agent,
                source=source, rate=rate, record=record, record_dir=record_dir,
                spot_host=spot_host, ros2=ros2, router_port=router_port, router_host=router_host,
                certs=certs, name=name, compact=compact, services=services, router=router,
                robots=robots, tracing=tracing, log_format=log_format,
            )
        )  # fmt: skip
        run_up(stack, Screen(), server)


@app.command()
def record(
    out: Annotated[Path, typer.Option(help="folder for the recordings")] = Path("recordings"),
    port: TypedPort = None,
    state: State = None,
    router: Annotated[
        str | None,
        typer.Option(help="router, tcp/HOST:PORT  [default: that of the running helios up]"),
    ] = None,
    certs: Certs = None,
    name: Annotated[
        str | None, typer.Option(help="name of the robot  [default: that of the running helios up]")
    ] = None,
    url: Url = None,
) -> None:
    """Record every topic of a running robot into MCAP, until Ctrl-C."""
    from helios_client.commands.record import bus_address
    from helios_client.commands.record import record as run_record

    run_record(out, bus_address("helios record", port, state, router, certs, name, url))


@app.command()
def replay(
    dataset: Annotated[Path, typer.Argument(help="recording (.mcap), data set or ROS bag")],
    out: Annotated[Path, typer.Option(help="folder for the results")],
    classes: Annotated[
        str | None,
        typer.Option(help='classes to find: "cup,dining table"  [default: the recorded searches]'),
    ] = None,
    detector: Annotated[
        str | None,
        typer.Option(help="detector: onnx:FILE, package:Class or another  [default: as recorded]"),
    ] = None,
    thresholds: Annotated[str, typer.Option(help='thresholds: "cup=0.25,dining table=0.35"')] = "",
    limit: Annotated[int, typer.Option(help="number of frames to play; 0: all", min=0)] = 0,
    from_s: Annotated[float, typer.Option("--from", help="start, in seconds", min=0)] = 0.0,
    to_s: Annotated[
        float | None, typer.Option("--to", help="end, in seconds  [default: its end]", min=0)
    ] = None,
    rate: Annotated[
        float,
        typer.Option(help="speed; 1: as recorded, 2: twice as fast, 0: without waiting", min=0),
    ] = 0.0,
    free_running: Annotated[
        bool, typer.Option(help="do not wait for the maps; the results then differ between runs")
    ] = False,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="refuse a damaged recording, end at an unreadable frame"),
    ] = False,
    topics: Annotated[
        str, typer.Option(help='topics of a ROS bag: "color=/a,depth=/b,info=/c,pose=/d"')
    ] = "",
    agent: Annotated[
        str, typer.Option(help="agent of the object map: use the one of the recorded helios up")
    ] = "helios",
) -> None:
    """Play a recording or data set and write the results. Runs the same services as helios up,
    without planner and gateway."""
    from helios_client.interrupt_signals import noted_interrupts

    with noted_interrupts() as interrupts:
        from helios_client.replay.input_selection import search_and_detector
        from helios_client.replay.run import PlaybackOptions, ReplayJob
        from helios_client.replay.run import replay as run_replay
        from helios_client.supervision.flag_checks import check_detector, check_source

        screen = console()
        check_source(dataset)
        context, detector = search_and_detector(dataset, classes, thresholds, detector)
        detector = check_detector(detector)
        playback = PlaybackOptions(limit, from_s, to_s, rate, free_running, topics, strict)
        job = ReplayJob(dataset, context, detector, out, playback, agent)
        results = run_replay(job, interrupts, screen)
        screen.print(results.table())  # first, as writing may fail on a full disk
        results.write(out)
        so_far = "interrupted: the results so far are " if results.summary["interrupted"] else ""
        screen.print(f"{so_far}written to {out}", highlight=False)
        interrupts.check()
