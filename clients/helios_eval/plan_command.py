"""The command `helios eval plan`: what HELIOS takes from the plan of a home, with a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def plan(
    file: Annotated[Path, typer.Argument(help="home drawn in Sweet Home 3D", metavar="FILE.sh3d")],
    level: Annotated[
        str, typer.Option(help="level of the plan  [default: that with most rooms]")
    ] = "",
    out: Annotated[
        Path | None, typer.Option(help="picture of the home and its rooms, FILE.png or .jpg")
    ] = None,
    seed: Annotated[int, typer.Option(help="seed of the household things in it", min=0)] = 0,
) -> None:
    """Print rooms, doors and furniture that HELIOS takes from a plan, and what it leaves out."""
    from helios_client.usage_errors import UsageError
    from helios_core.errors import HeliosError, Unavailable
    from helios_sim.episode_tracker import episode_of
    from helios_sim.home.task_sampling import NoTask
    from helios_sim.plans import PlanSource, drawn_home, home_of_plan
    from helios_sim.plans.plan_summary import summary

    if out is not None and out.suffix not in (".png", ".jpg", ".jpeg"):
        raise UsageError(f"--out is {str(out)!r}; a picture is written as FILE.png or FILE.jpg")
    try:
        source = PlanSource.of(file, level)
        lines = summary(drawn_home(source))
        home = home_of_plan(source, seed)
    except HeliosError as error:
        raise UsageError(error.message) from error
    print("\n".join(lines))
    print(f"with seed {seed}: {len(home.objects)} household things")
    try:
        print(f"a task: {episode_of(home, seed).instruction}")
    except NoTask as none:
        print(f"no task: {none.message}")
    if out is not None:
        from helios_sim.home.home_pictures import contact_sheet, write_picture

        try:
            write_picture(out, contact_sheet(home))
        except OSError as error:
            raise Unavailable(f"cannot write {out} ({error.strerror or error})") from error
        print(f"picture written to {out}")
