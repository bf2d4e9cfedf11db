"""Study of the cost of one step of an episode: CPU milliseconds by part, on one core.

    python -m helios_eval.studies.step_cost --agents helios,helios-paper --seeds 200,201 --steps 150
    python -m helios_eval.studies.step_cost --steps 1500 --preset ovmm-large-v1 --json after.json
    python -m helios_eval.studies.step_cost --against before.json

It plays each episode as `helios eval ovmm` does, and prints the mean of each part over all steps,
over the first third and over the last third of the steps. CPU time varies with the load of the
machine, so compare two versions only if you run them in turns on one machine. `--against` prints
the ratio to the figures of an earlier run.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from helios_client.usage_errors import UsageError
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError

from helios_eval.episodes.worker import prepare
from helios_eval.studies.development_homes import seeds

if TYPE_CHECKING:
    from helios_eval.episodes.episode_spec import EpisodeSpec

LEAST_STEPS = 10


def table(
    found: Mapping[str, Mapping[str, float]], before: Mapping[str, Mapping[str, float]] | None
) -> str:
    """Lines of a table; before: figures of an earlier run, for the ratio."""
    whole = found["all"]["all"]
    lines = [f"{'part':12}{'ms':>8}{'%':>6}{'first':>8}{'last':>8}{'ratio' if before else '':>8}"]
    for part, row in found.items():
        ratio = ""
        if before and part in before:
            ratio = f"{row['all'] / max(before[part]['all'], 1e-9):.2f}"
        lines.append(
            f"{part:12}{row['all']:8.2f}{100 * row['all'] / whole:6.1f}{row['first']:8.2f}"
            f"{row['last']:8.2f}{ratio:>8}"
        )
    return "\n".join(lines)


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.step_cost",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--agents", default="helios", help="some agents, such as helios,trusting")
    parser.add_argument("--seeds", type=seeds, default=(200,), help="homes, such as 200,201")
    parser.add_argument("--steps", type=int, default=150, help="most steps of each episode")
    parser.add_argument("--preset", default="ovmm-v1", help="kind of homes")
    parser.add_argument("--semantics", default="noisy", choices=("noisy", "ground-truth"))
    parser.add_argument("--sensor", default="none", choices=("none", "realistic"))
    parser.add_argument("--json", type=Path, help="file for the figures")
    parser.add_argument("--against", type=Path, help="figures of an earlier run")
    given = parser.parse_args(arguments)
    if given.steps < LEAST_STEPS:
        parser.error(f"--steps wants {LEAST_STEPS} or more, not {given.steps}")
    return given


def specs(given: argparse.Namespace) -> list[EpisodeSpec]:
    """Episodes of the arguments. Raises HeliosError for an unknown agent or preset."""
    from helios_eval.episodes import episode_spec as names
    from helios_eval.episodes import home_presets

    noise = None
    if given.semantics == "noisy":
        noise = names.noise_of(home_presets.noise_of(given.preset), 1.0, None)
    settings = {names.SCORER: names.DEFAULT_SCORER, names.MAX_STEPS: given.steps}
    if given.sensor != "none":
        settings[names.SENSOR] = given.sensor
    return [
        names.EpisodeSpec("ovmm", agent, given.semantics, given.preset, seed, noise, dict(settings))
        for agent in names.check_agents(given.agents.split(","), "ovmm")
        for seed in given.seeds
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    given = parsed(arguments)
    prepare()  # before numba and OpenCV are imported
    from helios_eval.studies.cpu_parts import measure, summary

    try:
        before = json.loads(given.against.read_text())["ms"] if given.against else None
        found = summary([measure(spec) for spec in specs(given)])
    except HeliosError as error:
        print(f"step_cost: {error.message}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except (OSError, ValueError, KeyError) as error:
        print(f"step_cost: {given.against} has no figures ({error})", file=sys.stderr)
        return 2
    print(table(found, before))
    if given.json is not None:
        asked = {name: str(value) for name, value in vars(given).items()}
        write_file(given.json, json.dumps({"asked": asked, "ms": found}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
