"""Commands for the maps of a running robot: `helios objects`, `seen` and `map`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from helios_client.commands.shared_options import (
    GatewayAddress,
    Json,
    console,
    flatten_options,
    print_json,
)

objects_app = typer.Typer()
app = typer.Typer(
    name="map", help="Maps of a running robot.", no_args_is_help=True, rich_markup_mode=None
)


@objects_app.command()
@flatten_options
def objects(
    at: GatewayAddress,
    class_name: Annotated[
        str | None, typer.Option("--class", help="only objects of this class")
    ] = None,
    min_score: Annotated[
        float | None, typer.Option(help="only objects with at least this score Ψ")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the objects of the object map, highest score first."""
    from helios_client.commands.tables import object_table, stored_table
    from helios_client.usage_errors import check_finite

    check_finite("--min-score", min_score)
    with at.connect() as helios:
        found = sorted(helios.objects(class_name, min_score), key=lambda o: -o.score)
        stored = sorted(helios.stored_objects(class_name, min_score), key=lambda o: -o.score)
    if as_json:
        print_json({"objects": [o.raw for o in found], "stored": [o.raw for o in stored]})
        return
    if found:
        console().print(object_table(found))
    if stored:
        console().print(stored_table(stored))
    if not found and not stored:
        least = "" if min_score is None else f" with a score of at least {min_score:g}"
        print(f"no {class_name or 'object'}{least} has been found yet")


@objects_app.command()
@flatten_options
def seen(
    prompt: Annotated[str, typer.Argument(help='object in words: mug, "something to drink from"')],
    at: GatewayAddress,
    limit: Annotated[int, typer.Option(help="maximum number of past views", min=1, max=50)] = 5,
    out: Annotated[Path | None, typer.Option(help="folder for the images of the views")] = None,
    as_json: Json = False,
) -> None:
    """Find where something was seen, with images. Lists objects of that name, and past views that
    fit the prompt."""
    from helios_client.commands.map_files import write_views
    from helios_client.commands.tables import seen_tables

    with at.connect() as helios:
        found = helios.seen(prompt, limit)
    paths = write_views(found.views, out) if out is not None else []
    if as_json:
        print_json(found.raw | {"files": [str(path) for path in paths]})
        return
    screen = console()
    for part in seen_tables(found):
        screen.print(part)
    for path in paths:
        print(path)


@app.command()
@flatten_options
def save(
    at: GatewayAddress,
    file: Annotated[Path, typer.Argument(help="file to write")] = Path("map.zip"),
    as_json: Json = False,
) -> None:
    """Save both maps, occupancy and objects, in one file."""
    from helios_client.commands.map_files import check_folder_of, write_file

    check_folder_of(file)
    with at.connect() as helios:
        data = helios.save_map()
    write_file(file, data)
    if as_json:
        print_json({"file": str(file), "bytes": len(data)})
    else:
        print(file)


@app.command()
@flatten_options
def load(
    at: GatewayAddress,
    file: Annotated[Path, typer.Argument(help="file written by helios map save")] = Path("map.zip"),
    same_frame: Annotated[
        bool,
        typer.Option("--same-frame", help="the robot's poses have the origin of the saved maps"),
    ] = False,
    as_json: Json = False,
) -> None:
    """Load both maps and replace the current ones.

    If the robot's poses have another origin than those of the file, the file is stored instead. It
    is in use once the robot has found its place in it. Refused while a task runs.
    """
    from helios_client.commands.map_files import read_file

    data = read_file(file)
    with at.connect() as helios:
        loaded = helios.load_map(data, same_frame)
    if as_json:
        print_json(loaded)
    elif loaded["stored"]:
        print(
            f"stored: {loaded['objects']} objects. The file has other coordinates than the robot "
            "has now. It is in use once the robot has found its place in it, which takes views "
            "from a task or a drive; helios objects shows the state"
        )
    else:
        print(
            f"loaded: {loaded['known_m2']:.0f} m² of known area, {loaded['objects']} objects with "
            f"{loaded['gaussians']} Gaussians, {loaded['views']} past views"
        )


@app.command()
@flatten_options
def reset(
    at: GatewayAddress,
    only: Annotated[
        Literal["objects", "occupancy"] | None,
        typer.Option(help="only this map; occupancy includes value layers and past views"),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="do not ask for confirmation")] = False,
    as_json: Json = False,
) -> None:
    """Discard both maps, or one. Use it after a home was rebuilt. Refused while a task runs."""
    from helios_client.commands.map_files import confirm_reset

    if not yes:
        confirm_reset(at.base_url, only)
    with at.connect() as helios:
        done = helios.reset_map(only)
    if as_json:
        print_json(done)
    else:
        print(f"discarded: {' and '.join(done['reset'])}; the next action starts a new map")


@app.command()
@flatten_options
def export(
    at: GatewayAddress,
    out: Annotated[Path, typer.Option(help="folder for the files")] = Path("runs/map"),
    only: Annotated[
        str | None, typer.Option(help="occupancy, or a value layer such as pick  [default: all]")
    ] = None,
    ros: Annotated[
        bool, typer.Option("--ros", help="write map.pgm and map.yaml for ROS's map_server instead")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write the 2D map as images (PNG) and arrays (NPZ), or for ROS."""
    from helios_client.commands.map_files import export_map, export_ros
    from helios_client.usage_errors import UsageError

    if ros and only is not None:
        raise UsageError("a map for ROS contains only the occupancy; omit --only or --ros")
    with at.connect() as helios:
        written = export_ros(helios, out) if ros else export_map(helios, out, only)
    if as_json:
        print_json({"files": [str(path) for path in written]})
    else:
        for path in written:
            print(path)
