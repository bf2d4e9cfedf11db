"""`helios objects` and `helios map`: what the robot believes about the home."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from helios_client.options import At, Json, console, flat, print_json

objects_app = typer.Typer()
app = typer.Typer(
    name="map", help="The maps of a running robot.", no_args_is_help=True, rich_markup_mode=None
)


@objects_app.command()
@flat
def objects(
    at: At,
    class_name: Annotated[
        str | None, typer.Option("--class", help="only those of this class")
    ] = None,
    min_score: Annotated[
        float | None, typer.Option(help="only those with a score Ψ from this on")
    ] = None,
    as_json: Json = False,
) -> None:
    """List what is believed to be where, the surest first."""
    from helios_client.lists import object_table

    with at.connect() as helios:
        found = sorted(helios.objects(class_name, min_score), key=lambda o: -o.score)
    if as_json:
        print_json({"objects": [one.raw for one in found]})
    elif found:
        console().print(object_table(found))
    else:
        print("nothing is believed yet" if class_name is None else f"no {class_name} is believed")


@app.command()
@flat
def export(
    at: At,
    out: Annotated[Path, typer.Option(help="folder for the files")] = Path("map"),
    only: Annotated[
        str | None, typer.Option(help="occupancy, or a value layer such as pick  [default: all]")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write the 2D map as pictures (PNG) and arrays (NPZ)."""
    from helios_client.map_files import export_map

    with at.connect() as helios:
        written = export_map(helios, out, only)
    if as_json:
        print_json({"files": [str(path) for path in written]})
    else:
        for path in written:
            print(path)
