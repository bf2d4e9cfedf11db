"""The command `helios eval calibration`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def calibration(
    folders: Annotated[
        list[Path], typer.Argument(help="result folders of `helios eval`, one for each setting")
    ],
    out: Annotated[Path, typer.Option(help="folder for calibration.md and the plots")],
    every_step: Annotated[
        bool,
        typer.Option("--every-step", help="all recorded beliefs, not only the last of each object"),
    ] = False,
) -> None:
    """Compare the object map's beliefs with ground truth. Reports reliability, ECE and AUROC."""
    from helios_eval.calibration import report  # matplotlib takes a second to load
    from helios_eval.run_folder import write_errors_as_unavailable

    with write_errors_as_unavailable(out):
        path = report.write(folders, out, every_step)
    print(f"written to {path}")
