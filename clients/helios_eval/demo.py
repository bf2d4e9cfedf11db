"""`make demo`: run one language task in a simulated home and judge it by ground truth.

    python -m helios_eval.demo --seed 3 --out runs/demo

Starts `helios up` (router, world and every service as separate processes), submits the task of the
home's seed over HTTP, prints its progress, and writes `result.json` and images.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from helios_client.answer_types import Task
from helios_client.commands.task_view import run_task
from helios_client.sdk import Helios
from helios_client.supervision.service_specs import free_port
from helios_client.supervision.up import check_port
from helios_client.usage_errors import check_writable
from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.topics import TRUTH_EPISODE, TRUTH_METRICS
from helios_core.zenoh_bus import ZenohBus
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from helios_eval.demo_pictures import object_picture

READY_WITHIN_S = 120.0
TASK_WITHIN_S = 900.0
CALL_S = 20.0
OTHER_PORT = "--port (make demo PORT=…)"


@contextmanager
def running_stack_process(arguments: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run `helios up` with these arguments; terminate it at the end of the block."""
    command = [sys.executable, "-m", "helios_client", "up", *arguments]
    with log.open("wb") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def wait_ready(helios: Helios, up: subprocess.Popen[bytes], log: Path, console: Console) -> None:
    """Wait until a task can start, and print each service that gets ready.

    Raises Unavailable after a time-out, with the reasons of the services that are not ready, and
    when `helios up` ends.
    """
    began_s = time.monotonic()
    deadline_s = began_s + READY_WITHIN_S
    said: set[str] = set()
    while up.poll() is not None or not helios.ready():  # another stack may answer on this port
        if up.poll() is not None:
            raise Unavailable(f"helios up ended: {log.read_text(errors='replace').strip()[-500:]}")
        for name in sorted(_ready_services(helios) - said):
            said.add(name)
            console.print(
                f"  {time.monotonic() - began_s:4.0f} s  {name} is ready", highlight=False
            )
        if time.monotonic() > deadline_s:
            waiting = [
                f"{s['name']}: {s['reason'] or s['state']}"
                for s in helios.status()["services"]
                if s["state"] != "ready"
            ]
            raise Unavailable(f"not ready after {READY_WITHIN_S:g} s: {'; '.join(waiting)}")
        time.sleep(0.2)


def _ready_services(helios: Helios) -> set[str]:
    try:
        return {s["name"] for s in helios.status()["services"] if s["state"] == "ready"}
    except HeliosError:  # the gateway itself is still starting
        return set()


def result_of(task: Task, truth: pb.TruthEpisode, metrics: pb.TruthMetrics, wall_s: float) -> dict:
    """Content of `result.json`; `success` comes from the simulator, not from the planner."""
    return {
        "success": metrics.success,
        "collision": metrics.collision,
        "phases": {
            "find_object": metrics.find_object,
            "pick": metrics.pick,
            "find_receptacle": metrics.find_receptacle,
            "place": metrics.place,
        },
        "steps": metrics.steps,
        "wall_s": round(wall_s, 2),
        "instruction": truth.instruction,
        "seed": truth.seed,
        "preset": truth.preset,
        "task": {"id": task.id, "state": task.state, "message": task.message},
        "collided_with": list(metrics.collided_with),
    }


def show(result: dict, out: Path, console: Console) -> None:
    console.print(f"[bold]{escape(result['instruction'])}[/]")
    table = Table(show_header=False)
    good = {True: "[green]yes[/]", False: "[red]no[/]"}
    table.add_row("success", good[result["success"]])
    for phase, done in result["phases"].items():
        table.add_row(phase.replace("_", " "), good[done])
    touched = f" ({', '.join(result['collided_with'])})" if result["collision"] else ""
    table.add_row("collision", ("[red]yes[/]" if result["collision"] else "[green]no[/]") + touched)
    table.add_row("steps", str(result["steps"]))
    table.add_row("seconds", f"{result['wall_s']:.0f}")
    console.print(table)
    console.print(f"result and images: {out}", highlight=False)


def next_steps(result: dict, port: int) -> str:
    """Message with the shell commands for further tasks in the same home."""
    seed, preset = result["seed"], result["preset"]
    up, task = f"helios up --robot sim --seed {seed}", f'helios task "{result["instruction"]}"'
    if preset != "demo-v1":
        up += f" --preset {preset}"
    if port != 8080:
        up, task = f"{up} --port {port}", f"{task} --port {port}"
    names = "helios names --here" + ("" if port == 8080 else f" --port {port}")
    return (
        "this HELIOS has ended; to run your own tasks in the same home:\n"
        f"  source .venv/bin/activate\n  {up}    # until Ctrl-C; then in another terminal:\n"
        f"  {task}    # for more tasks: {names}"
    )


def run(seed: int, preset: str, port: int, out: Path, console: Console) -> dict:
    """Run one demo; return the content of `result.json`. Raises HeliosError."""
    check_port(port, OTHER_PORT)
    check_writable(out / "up.log")
    log, router_port = out / "up.log", free_port(apart_from=port)
    arguments = [
        "--robot", "sim", "--seed", str(seed), "--preset", preset, "--port", str(port),
        "--router-port", str(router_port), "--state", str(out / "state"),
    ]  # fmt: skip
    with running_stack_process(arguments, log) as up, Helios(f"http://127.0.0.1:{port}") as helios:
        console.print(f"starting router, world and services (home {seed}, preset {preset})")
        console.print(
            "compiling kernels takes a minute, unless `make install` has done it", style="dim"
        )
        wait_ready(helios, up, log, console)
        console.print(
            f"dashboard while this runs: http://127.0.0.1:{port}/",
            style="bold cyan",
            soft_wrap=True,
        )
        bus = ZenohBus(f"tcp/127.0.0.1:{router_port}")
        try:
            truth = bus.call(TRUTH_EPISODE, pb.Empty(), CALL_S)
            console.print(f"task: {truth.instruction}", style="bold", highlight=False, markup=False)
            began = time.monotonic()
            task = run_task(helios, truth.instruction, TASK_WITHIN_S, console)
            wall_s = time.monotonic() - began
            metrics = bus.call(TRUTH_METRICS, pb.Empty(), CALL_S)
            result = result_of(task, truth, metrics, wall_s)
            write_file(out / "result.json", json.dumps(result, indent=1) + "\n")
            write_file(out / "map.png", helios.picture("occupancy"))
            for layer in ("pick", "place"):
                write_file(out / f"value-{layer}.png", helios.picture(f"value/{layer}"))
            write_file(out / "objects.png", object_picture(bus, helios.occupancy()))
        finally:
            bus.close()
    show(result, out, console)
    console.print(next_steps(result, port), highlight=False, markup=False, soft_wrap=True)
    return result


def check_seed(seed: int) -> None:
    """Raises InvalidInput for a home that is not for development."""
    from helios_eval.ledger import FIRST_SEED  # late import: it takes a second

    if not 0 <= seed < FIRST_SEED:
        raise InvalidInput(
            f"--seed is {seed}; the demo plays homes 0 to {FIRST_SEED - 1}, since later ones "
            "belong to published results; `helios eval` plays those, and enters them in the ledger"
        )


def port_number(text: str) -> int:
    """Port of a command line. Raises ValueError, and ArgumentTypeError outside 1 to 65535."""
    port = int(text)
    if not 0 < port < 65536:
        raise argparse.ArgumentTypeError(f"{port} is no port; wanted 1 to 65535")
    return port


def main() -> int:
    parser = argparse.ArgumentParser(prog="helios-demo", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="seed of the home")
    parser.add_argument("--preset", default="demo-v1", help="preset of home and detector noise")
    parser.add_argument("--port", type=port_number, default=8080, help="port of the HTTP interface")
    parser.add_argument(
        "--out", type=Path, default=Path("runs/demo"), help="folder for the results"
    )
    args = parser.parse_args()
    try:
        check_seed(args.seed)
        result = run(args.seed, args.preset, args.port, args.out, Console())
    except HeliosError as error:
        print(f"helios-demo: {error.message}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0 if result["success"] else 1


if __name__ == "__main__":
    sys.exit(main())
