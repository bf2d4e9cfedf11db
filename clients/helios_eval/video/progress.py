"""Progress of a filmed episode: a bar on a terminal, else occasional lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

LINE_EVERY = 25  # steps


@contextmanager
def counted(console: Console, what: str, most: int) -> Iterator[Callable[[int], None]]:
    """Callback for the number of steps taken, of `most` that the episode may take."""
    if not console.is_terminal:
        yield _lines(console, what, most)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("step {task.completed} of at most {task.total}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        bar = progress.add_task(what, total=most)
        yield lambda step: progress.update(bar, completed=step)


def _lines(console: Console, what: str, most: int) -> Callable[[int], None]:
    said = -1

    def on_step(step: int) -> None:
        nonlocal said
        if step // LINE_EVERY > said:
            said = step // LINE_EVERY
            line = f"{what}: step {step} of at most {most}"
            print(line, file=console.file, flush=True)

    on_step(0)
    return on_step
