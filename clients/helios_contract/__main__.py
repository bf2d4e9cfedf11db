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
        description="Test a robot driver, a detector or a scorer. With a driver THE ROBOT MOVES: "
        "it turns on the spot and drives ahead one and a half times the distance given; one that "
        "can move back does so once by at most that distance, and drives ahead once more. Keep a "
        "hand on its emergency stop.",
        epilog="What follows -- goes to pytest: -- -x -k stop",
    )
    one = parser.add_mutually_exclusive_group(required=True)
    one.add_argument("driver", nargs="?", help="my_package:MyRobot, importable from here")
    one.add_argument("--detector", help="my_package:Mine, or as --detector of helios up")
    one.add_argument("--scorer", help="my_package:Mine, or as --scorer of helios up")
    robots = parser.add_argument_group("of a driver")
    robots.add_argument("--address", default="", help="of the robot, where its driver asks for one")
    robots.add_argument("--forward-m", type=float, default=Rig.forward_m, help="of one drive")
    robots.add_argument("--turn-rad", type=float, default=Rig.turn_rad, help="of one turn")
    robots.add_argument(
        "--tolerance-m", type=float, default=Rig.tolerance_m, help="after a drive or turn"
    )
    robots.add_argument("--tolerance-rad", type=float, default=Rig.tolerance_rad)
    robots.add_argument("--depth-tolerance-m", type=float, default=Rig.depth_tolerance_m)
    robots.add_argument(
        "--start-twice", action="store_true",
        help="make a second driver beside the first, to see that it names the same origin",
    )  # fmt: skip
    models = parser.add_argument_group("of a detector or a scorer")
    models.add_argument(
        "--classes", default="", help="names to ask for, by comma  [default: of its vocabulary]"
    )
    models.add_argument(
        "--image", action="append", default=[], type=Path, metavar="FILE",
        help="a picture in which the detector finds one of them; repeatable",
    )  # fmt: skip
    models.add_argument(
        "--random", action="store_true", help="the same frame may give other findings each time"
    )
    return parser


def _choose(args: argparse.Namespace) -> str:
    """Prepare the chosen tests. Returns the name of their file. Raises HeliosError."""
    options, pictures = DetectorOptions(), tuple(_picture(path) for path in args.image)
    if args.detector:
        names = tuple(name.strip() for name in args.classes.split(",") if name.strip())
        command_line_choice.detector = DetectorBench(
            lambda: open_detector(args.detector, options),
            pictures,
            not args.random,
            classes=names,
        )
        _ = command_line_choice.detector.detector  # a loading error is no failed test
        return "chosen_detector.py"
    if args.scorer:
        command_line_choice.scorer = ScorerBench(
            lambda: open_scorer(args.scorer, options), pictures, not args.random
        )
        _ = command_line_choice.scorer.scorer
        return "chosen_scorer.py"
    settings = Settings(driver=args.driver, address=args.address)

    def start() -> closing[RobotDriver]:
        return closing(load_driver(settings, MemoryBus(MemoryHub())))

    command_line_choice.rig = Rig(
        load_driver(settings, MemoryBus(MemoryHub())),
        args.forward_m, args.turn_rad, args.tolerance_m, args.tolerance_rad,
        args.depth_tolerance_m, started_again=start if args.start_twice else None,
    )  # fmt: skip
    return "chosen_driver.py"


def _picture(path: Path) -> np.ndarray:
    """RGB image [h, w, 3] of a file. Raises InvalidInput."""
    color = cv2.imread(str(path))
    if color is None:
        raise InvalidInput(f"--image {path} is no picture that can be read; give a JPEG or PNG")
    return cv2.cvtColor(color, cv2.COLOR_BGR2RGB)


if __name__ == "__main__":
    sys.exit(main())
