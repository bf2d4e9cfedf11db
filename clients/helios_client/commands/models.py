"""`helios models`: model weights on this machine."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from helios_client.commands.shared_options import Json, console, print_json, print_line

if TYPE_CHECKING:
    from helios_core.models.model_folder import LockedModel

app = typer.Typer(
    name="models",
    help="Model weights: list, fetch before use, verify. Services never download any.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Folder = Annotated[
    Path | None,
    typer.Option(
        help="folder of the models  [default: $HELIOS_MODELS, or $XDG_DATA_HOME/helios/models]"
    ),
]
MB = 1e6


@app.command(name="list")
def list_models(folder: Folder = None, as_json: Json = False) -> None:
    """List the models that the documents recommend, and those fetched, with size and licence."""
    from helios_core.models.model_folder import default_folder
    from rich.markup import escape
    from rich.table import Table

    from helios_client.models.listing import rows

    folder = folder or default_folder()
    found = rows(folder)
    if as_json:
        print_json({"folder": str(folder), "models": [asdict(row) for row in found]})
        return
    table = Table("model", "for", "size", "licence", "here", "note")
    for row in found:
        cells = (row.id, row.use, row.size, row.licence, row.state, row.note)
        table.add_row(*map(escape, cells))
    console().print(table)
    print_line(f"folder: {folder}")
    print_line(
        "sizes with ~ are estimates, 4 bytes for each parameter by the publisher's page; the "
        "others are exact"
    )


@app.command()
def fetch(
    names: Annotated[
        list[str], typer.Argument(help="models: a name of `helios models list`, or OWNER/NAME")
    ],
    to: Annotated[
        Path | None,
        typer.Option(help="folder  [default: $HELIOS_MODELS, or $XDG_DATA_HOME/helios/models]"),
    ] = None,
    revision: Annotated[
        str | None, typer.Option(help="commit, tag or branch of the hub  [default: the newest]")
    ] = None,
) -> None:
    """Download models and check them against the publisher's checksums. An interrupted download
    continues when you run the command again."""
    import sys

    from helios_core.models.catalogue import HUB, PACKAGE, kind_of, size_text
    from helios_core.models.model_folder import default_folder

    from helios_client.models import hub
    from helios_client.models.fetching import check_package, id_of
    from helios_client.usage_errors import UsageError

    ids = list(dict.fromkeys(id_of(name) for name in names))
    if revision is not None and len(ids) > 1:
        raise UsageError("--revision is valid only with one model")
    folder = to or default_folder()
    if any(kind_of(id) == HUB for id in ids):
        hub.show_progress(sys.stderr.isatty())
    for id in ids:
        if kind_of(id) == PACKAGE:
            check_package(id)
            print_line(f"{id} is already there, in its Python package")
            continue
        made = _fetch_with_bar(id, folder, revision)
        commit = f", revision {made.revision[:12]}" if made.revision else ""
        print_line(f"{id}: {size_text(made.bytes / MB)} in {folder}{commit}; checksums are right")


def _fetch_with_bar(id: str, folder: Path, revision: str | None) -> LockedModel:
    """Fetch with a progress bar for an ONNX file; the hub's library has its own."""
    from rich.progress import DownloadColumn, Progress, TransferSpeedColumn

    from helios_client.models.fetching import fetch as run_fetch

    columns = (*Progress.get_default_columns(), DownloadColumn(), TransferSpeedColumn())
    screen = console(stderr=True)
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task(id, total=None, visible=False)

        def show(done: int, of: int | None) -> None:
            bar.update(task, completed=done, total=of, visible=True)

        return run_fetch(id, folder, revision, print_line, show)


@app.command()
def verify(
    names: Annotated[
        list[str] | None, typer.Argument(help="models  [default: every fetched one]")
    ] = None,
    folder: Folder = None,
    as_json: Json = False,
) -> None:
    """Compare every file with the checksum of its fetching. Exit status 1 if one differs."""
    from helios_core.models.model_folder import default_folder, place_of, read_lock

    from helios_client.models.checksums import problems
    from helios_client.models.fetching import id_of
    from helios_client.usage_errors import UsageError

    folder = folder or default_folder()
    lock = read_lock(folder)
    ids = [id_of(name) for name in names] if names else sorted(lock)
    if unknown := [id for id in ids if id not in lock]:
        raise UsageError(f"{unknown[0]} is not in {folder}; run `helios models fetch {unknown[0]}`")
    if not ids:
        raise UsageError(f"{folder} has no fetched model; run `helios models fetch NAME`")
    wrong = {id: problems(place_of(folder, id), lock[id]) for id in ids}
    if as_json:
        print_json({"folder": str(folder), "models": wrong})
    for id, found in ({} if as_json else wrong).items():
        said = f"{len(lock[id].files)} files are right"
        if found:
            said = f"{'; '.join(found)}; run `helios models fetch {id}`"
        print_line(f"{id}: {said}", stderr=bool(found))
    raise typer.Exit(1 if any(wrong.values()) else 0)
