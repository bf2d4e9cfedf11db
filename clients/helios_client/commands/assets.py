"""`helios assets`: realistic furniture for simulated homes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from helios_client.commands.shared_options import console

app = typer.Typer(
    name="assets",
    help="Realistic furniture for simulated homes. Source: Debian's sweethome3d-furniture.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Cache = Annotated[
    Path | None,
    typer.Option(help="folder of baked furniture  [default: $XDG_CACHE_HOME/helios/furniture]"),
]


@app.command()
def bake(
    source: Annotated[
        Path | None,
        typer.Option(
            help="folder with .sh3f files, .sh3f or .deb  [default: the installed package]"
        ),
    ] = None,
    cache: Cache = None,
) -> None:
    """Convert the furniture package to small models. Takes a few minutes, once; the models are
    cached."""
    from helios_sim.assets.asset_baking import bake as run_bake
    from rich.progress import Progress

    with Progress(console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("baking")
        baked = run_bake(
            source, cache, progress=lambda done, of: bar.update(task, completed=done, total=of)
        )
    for why in baked.left_out.values():
        print(f"skipped: {why}")
    how = "baked into" if baked.fresh else "already baked in"
    print(f"{len(baked.pack.models)} models {how} {baked.folder}")
    print(f"authors and licences: {baked.folder / 'ATTRIBUTIONS.md'}")


@app.command()
def show(
    cache: Cache = None,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON only")] = False,
) -> None:
    """List the baked furniture: class, model, size, author and licence."""
    from helios_sim.assets import asset_pack as packs
    from helios_sim.assets.asset_report import rows_of
    from rich.table import Table

    pack = packs.read(cache)
    rows = rows_of(pack)
    if as_json:
        print(json.dumps({"digest": pack.digest, "models": rows}, indent=1))
        return
    table = Table("class", "model", "size (cm)", "triangles", "boxes", "author", "licence")
    for row in rows:
        size = " x ".join(f"{100 * side:.0f}" for side in row["size_m"])
        table.add_row(
            ", ".join(row["classes"]),
            row["key"],
            size,
            str(row["triangles"]),
            str(row["boxes"]),
            row["author"],
            row["licence"],
        )
    console().print(table)
    print(f"{len(rows)} models, pack {pack.digest[:12]}")
