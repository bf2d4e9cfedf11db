"""Entry point `python -m helios_contract`: contract tests of a driver, a detector or a scorer.

Call it with `my_package:MyRobot`, `--detector my_package:Mine` or `--scorer …`.
"""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from helios_bridge.driver_loading import load_driver
from helios_bridge.settings import Settings
from helios_core.errors import HeliosError, InvalidInput
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import RobotDriver
from helios_detector.backend import DetectorOptions
from helios_detector.model_loading import open_detector, open_scorer

from helios_contract import command_line_choice
from helios_contract.bench import DetectorBench, ScorerBench
from helios_contract.rig import Rig

HERE = Path(__file__).parent  # pytest imports its files, so asserts show their values


def main() -> int:
    argv = sys.argv[1:]
    at = argv.index("--") if "--" in argv else len(argv)
    args = _parser().parse_args(argv[:at])
    try:
        suite = _choose(args)
    except HeliosError as error:
        print(f"helios-contract: {error.message}", file=sys.stderr)
        return 2
    alone = ["-c", os.devnull, "--rootdir", str(Path.cwd()), "-p", "no:cacheprovider"]
    shown = ["-v", "-rfEs", "--no-header"]  # shows the reasons of skipped tests
    return int(pytest.main([*alone, *shown, str(HERE / suite), *argv[at + 1 :]]))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_contract",
        description="Test a robot driver, a detector or a scorer. With a driver, THE ROBOT MOVES: "
        "it turns on the spot, once all the way round, and drives forward one and a half times the "
        "given distance; a robot that can move back does so once, by at most that distance, and "
        "drives forward once more. Keep a hand on its emergency stop.",
        epilog="Arguments after -- go to pytest: -- -x -k stop",
    )
    one = parser.add_mutually_exclusive_group(required=True)
    one.add_argument(
        "driver", nargs="?", help="my_package:MyRobot, importable from the current folder"
    )
    one.add_argument("--detector", help="my_package:Mine, or a value of helios up --detector")
    one.add_argument("--scorer", help="my_package:Mine, or a value of helios up --scorer")
    robots = parser.add_argument_group("options for a driver")
    robots.add_argument(
        "--address", default="", help="address of the robot, if its driver needs one"
    )
    robots.add_argument(
        "--forward-m", type=float, default=Rig.forward_m, help="distance of one drive"
    )
    robots.add_argument("--turn-rad", type=float, default=Rig.turn_rad, help="angle of one turn")
    robots.add_argument(
        "--tolerance-m", type=float, default=Rig.tolerance_m, help="tolerance after a drive or turn"
    )
    robots.add_argument("--tolerance-rad", type=float, default=Rig.tolerance_rad)
    robots.add_argument("--depth-tolerance-m", type=float, default=Rig.depth_tolerance_m)
    robots.add_argument(
        "--start-twice",
        action="store_true",
        help="create a second driver beside the first and check that it names the same origin",
    )
    models = parser.add_argument_group("options for a detector or a scorer")
    models.add_argument(
        "--classes",
        default="",
        help="class names to request, separated by commas  [default: from its vocabulary]",
    )
    models.add_argument(
        "--image",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="image in which the detector finds one of the classes; repeatable",
    )
    models.add_argument(
        "--random", action="store_true", help="allow different results for the same frame"
    )
    return parser


def _choose(args: argparse.Namespace) -> str:
    """Prepare the chosen tests. Returns the name of their file. Raises HeliosError."""
    options, pictures = DetectorOptions(), tuple(_picture(path) for path in args.image)
    if args.detector is not None:
        names = tuple(name.strip() for name in args.classes.split(",") if name.strip())
        command_line_choice.detector = DetectorBench(
            lambda: open_detector(args.detector, options),
            pictures,
            not args.random,
            classes=names,
        )
        _ = command_line_choice.detector.detector  # a loading error is no failed test
        return "chosen_detector.py"
    if args.scorer is not None:
        command_line_choice.scorer = ScorerBench(
            lambda: open_scorer(args.scorer, options), pictures, not args.random
        )
        _ = command_line_choice.scorer.scorer
        return "chosen_scorer.py"
    settings = Settings.read(driver=args.driver, address=args.address)

    def start() -> closing[RobotDriver]:
        return closing(load_driver(settings, MemoryBus(MemoryHub())))

    command_line_choice.rig = Rig(
        load_driver(settings, MemoryBus(MemoryHub())),
        args.forward_m,
        args.turn_rad,
        args.tolerance_m,
        args.tolerance_rad,
        args.depth_tolerance_m,
        started_again=start if args.start_twice else None,
    ).ready()
    return "chosen_driver.py"


def _picture(path: Path) -> np.ndarray:
    """RGB image [h, w, 3] of a file. Raises InvalidInput."""
    color = cv2.imread(str(path))
    if color is None:
        raise InvalidInput(f"--image {path} is not a readable image; give a JPEG or PNG")
    return cv2.cvtColor(color, cv2.COLOR_BGR2RGB)


if __name__ == "__main__":
    sys.exit(main())
