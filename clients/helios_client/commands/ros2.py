"""`helios ros2`: what HELIOS needs of ROS 2."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from helios_client.commands.shared_options import console

app = typer.Typer(
    name="ros2",
    help="ROS 2: interfaces that pip does not have.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.callback()
def _group() -> None:
    """ROS 2: interfaces that pip does not have."""


@app.command("build-interfaces")
def build_interfaces(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="folder to build in; packages of your own in DIR/src are built too"
        ),
    ],
    only: Annotated[
        str, typer.Option(help='packages to build: "tf2_msgs,nav2_msgs"  [default: all]')
    ] = "",
    no_install: Annotated[
        bool, typer.Option("--no-install", help="leave them in DIR/install")
    ] = False,
    sources: Annotated[
        bool,
        typer.Option("--sources", help="only write helios_msgs into DIR/src, for colcon"),
    ] = False,
) -> None:
    """Build tf2_msgs, nav2_msgs, vision_msgs and helios_msgs for pip's rclpy. Needs gcc and
    cmake; takes some minutes. --sources needs neither."""
    from helios_core.errors import InvalidInput
    from helios_ros2 import interface_build as build

    from helios_client.supervision.ros2_python import chosen_ros2_python
    from helios_client.usage_errors import UsageError

    folder = folder.resolve()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder} cannot be made: {error.strerror or error}") from error
    if sources:
        print(f"wrote {build.write_our_sources(folder / 'src')}; build it with colcon")
        return
    screen = console(stderr=True)
    ros = build.ros_python(chosen_ros2_python())
    wanted = [name.strip() for name in only.split(",") if name.strip()]
    try:
        names = build.build(folder, ros, wanted, lambda words: screen.print(words, highlight=False))
    except InvalidInput as error:  # no such package
        raise UsageError(error.message) from error
    if no_install:
        print(f"built {', '.join(names)} in {folder / 'install'}")
        return
    build.install(folder, ros)
    print(f"built {', '.join(names)} and installed them into {ros.prefix}")
