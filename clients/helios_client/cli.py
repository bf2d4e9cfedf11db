"""Command line `helios`. Each command imports its dependencies only when it runs.

Exit status: 0 success, 1 failure, 2 wrong use, 129 hung up, 130 interrupted.
"""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer

from helios_client.commands.assets import app as assets_app
from helios_client.commands.certs import app as certs_app
from helios_client.commands.chaos import app as chaos_app
from helios_client.commands.evaluation import app as judge_app
from helios_client.commands.faults import app as faults_app
from helios_client.commands.fleet import app as fleet_app
from helios_client.commands.hangup_signal import HungUp
from helios_client.commands.map import app as map_app
from helios_client.commands.map import objects_app
from helios_client.commands.models import app as models_app
from helios_client.commands.movement import app as moves_app
from helios_client.commands.robot import app as robot_app
from helios_client.commands.ros2 import app as ros2_app
from helios_client.commands.shared_options import print_line
from helios_client.commands.start_services import app as run_app
from helios_client.commands.tasks import app as tasks_app
from helios_client.commands.view import app as view_app
from helios_client.commands.why import app as why_app
from helios_client.interrupt_signals import NUMBERS, BurstHandler, ignore_interrupts
from helios_client.leading_options import EVERYWHERE, leading

INTERRUPTED = 130

app = typer.Typer(
    name="helios",
    help="Perception and planning for language-directed pick and place.",
    epilog=f"{', '.join(EVERYWHERE)} may also precede the command. Exit status: 0 success, "
    "1 failure, 2 usage error, 129 terminal closed, 130 interrupted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for part in (
    run_app, tasks_app, moves_app, why_app, faults_app, robot_app, objects_app, map_app, judge_app,
    assets_app, ros2_app, certs_app, view_app, models_app, chaos_app, fleet_app,
):  # fmt: skip
    app.add_typer(part)


def _version(wanted: bool) -> None:
    from helios_client.version import helios_version

    if wanted:
        print(f"helios {helios_version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="print the version and exit", is_eager=True, callback=_version
        ),
    ] = False,
) -> None:
    """Perception and planning for language-directed pick and place."""


def main() -> int:
    """Run the command line of this process and return its exit status.

    SIGINT interrupts even if a shell script started this process in the background, with SIGINT
    ignored.
    """
    bursts = BurstHandler()
    for number in NUMBERS:
        signal.signal(number, bursts)
    try:
        return run(sys.argv[1:])
    finally:
        ignore_interrupts()


def run(args: Sequence[str]) -> int:
    """Run a command and return its exit status: 0 only on success, 2 on wrong use."""
    command = typer.main.get_command(app)
    try:
        code = command.main(args=_placed(command, args), prog_name="helios", standalone_mode=False)
        if code == INTERRUPTED:  # the parser's exit status for Ctrl-C
            return _interrupted()
        return code if isinstance(code, int) else 0
    except KeyboardInterrupt:
        return _interrupted()
    except HungUp as hung_up:
        with contextlib.suppress(OSError):  # the terminal may be closed
            print_line(f"helios: the terminal was closed; {hung_up}", stderr=True)
        return 129
    except BrokenPipeError:
        with contextlib.suppress(OSError):
            sys.stdout.close()
        return 1
    except Exception as error:
        return _tell(error)


def _placed(command: Any, args: Sequence[str]) -> list[str]:
    """Arguments with the options before a command moved behind it."""
    before, rest = leading(args)
    words = 0
    while words < len(rest) and (inner := getattr(command, "commands", {}).get(rest[words])):
        command, words = inner, words + 1
    return [*rest[:words], *(before if words else ()), *rest[words:]]


def _tell(error: Exception) -> int:
    """Print an error as one sentence on stderr and return the exit status.

    Raises it again if it is neither a HeliosError nor an error of the command-line parser.
    """
    format_message = getattr(error, "format_message", None)
    if format_message is not None:  # an error of the command-line parser
        from helios_core.printable_text import plain_error

        sentence = plain_error(format_message()).rstrip(".")
        if sentence.startswith("Usage:"):  # a group without a command
            print(sentence, file=sys.stderr)
        elif sentence:
            command = getattr(getattr(error, "ctx", None), "command_path", None) or "helios"
            if command == "helios" and (option := getattr(error, "option_name", None)):
                sentence = (
                    f"there is no option {option} before the command; the options of a command "
                    f"follow it: helios COMMAND {option}"
                )
            print_line(f"helios: {sentence}; see {command} --help", stderr=True)
        return 2
    if type(error).__name__ == "Abort":  # Ctrl-C or end of input at a prompt
        return _interrupted()
    from helios_core.errors import HeliosError

    from helios_client.http.errors import WrongRequest
    from helios_client.usage_errors import UsageError

    if not isinstance(error, HeliosError):
        raise error
    print_line(f"helios: {error.message}", stderr=True)
    return 2 if isinstance(error, UsageError | WrongRequest) else 1


def _interrupted() -> int:
    print("helios: interrupted", file=sys.stderr)
    return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
