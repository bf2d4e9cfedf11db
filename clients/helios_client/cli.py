"""The command `helios`. Each command imports what it needs only when it runs.

Exit status: 0 success, 1 failure, 2 wrong use, 130 interrupted.
"""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Sequence

import typer

from helios_client.commands.assets import app as assets_app
from helios_client.commands.judge import app as judge_app
from helios_client.commands.map import app as map_app
from helios_client.commands.map import objects_app
from helios_client.commands.moves import app as moves_app
from helios_client.commands.robot import app as robot_app
from helios_client.commands.run import app as run_app
from helios_client.commands.tasks import app as tasks_app
from helios_client.commands.why import app as why_app

app = typer.Typer(
    name="helios",
    help="Perception and planning for language-directed pick and place.",
    epilog="Exit status: 0 success, 1 failure, 2 wrong use, 130 interrupted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for part in (
    run_app, tasks_app, moves_app, why_app, robot_app, objects_app, map_app, judge_app, assets_app
):  # fmt: skip
    app.add_typer(part)


def main() -> int:
    """The entry point."""
    signal.signal(signal.SIGTERM, _interrupt)
    return run(sys.argv[1:])


def run(args: Sequence[str]) -> int:
    """Run a command; the exit status: 0 only on success, 2 on wrong use."""
    command = typer.main.get_command(app)
    try:
        code = command.main(args=list(args), prog_name="helios", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except KeyboardInterrupt:
        return _interrupted()
    except BrokenPipeError:
        with contextlib.suppress(OSError):
            sys.stdout.close()
        return 1
    except Exception as error:
        return _tell(error)


def _tell(error: Exception) -> int:
    """One sentence on stderr; faults of ours keep their traceback."""
    format_message = getattr(error, "format_message", None)
    if format_message is not None:  # of the command-line parser, whichever it is built on
        sentence = format_message().rstrip(".")
        if sentence.startswith("Usage:"):  # a group without a command
            print(sentence, file=sys.stderr)
        elif sentence:
            command = getattr(getattr(error, "ctx", None), "command_path", None) or "helios"
            print(f"helios: {sentence}; see {command} --help", file=sys.stderr)
        return 2
    if type(error).__name__ == "Abort":  # what the parser makes of Ctrl-C
        return _interrupted()
    from helios_core.errors import HeliosError

    from helios_client.http.errors import WrongRequest
    from helios_client.wrong_use import WrongUse

    if not isinstance(error, HeliosError):
        raise error
    print(f"helios: {error.message}", file=sys.stderr)
    return 2 if isinstance(error, WrongUse | WrongRequest) else 1


def _interrupted() -> int:
    print("helios: interrupted", file=sys.stderr)
    return 130


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
