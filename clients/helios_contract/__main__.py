"""`python -m helios_contract my_package:MyRobot`: does a driver keep the contract?"""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import closing
from pathlib import Path

import pytest
from helios_bridge.drivers import load_driver
from helios_bridge.settings import Settings
from helios_core.errors import HeliosError
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import RobotDriver

from helios_contract import chosen
from helios_contract.rig import Rig

ANY_DRIVER = Path(__file__).with_name("any_driver.py")  # imported by pytest: so asserts say values


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_contract",
        description="Test a robot driver. THE ROBOT MOVES: it turns on the spot and drives ahead "
        "one and a half times the distance given; one that can move back does so once by at most "
        "that distance, and drives ahead once more. Keep a hand on its emergency stop.",
        epilog="What follows -- goes to pytest: -- -x -k stop",
    )
    parser.add_argument("driver", help="my_package:MyRobot, importable from here")
    parser.add_argument("--address", default="", help="of the robot, for drivers that ask for one")
    parser.add_argument("--forward-m", type=float, default=Rig.forward_m, help="of one drive")
    parser.add_argument("--turn-rad", type=float, default=Rig.turn_rad, help="of one turn")
    parser.add_argument(
        "--tolerance-m", type=float, default=Rig.tolerance_m, help="after a drive or turn"
    )
    parser.add_argument("--tolerance-rad", type=float, default=Rig.tolerance_rad)
    parser.add_argument("--depth-tolerance-m", type=float, default=Rig.depth_tolerance_m)
    parser.add_argument(
        "--start-twice", action="store_true",
        help="make a second driver beside the first, to see that it names the same origin",
    )  # fmt: skip
    argv = sys.argv[1:]
    at = argv.index("--") if "--" in argv else len(argv)
    args = vars(parser.parse_args(argv[:at]))
    name, address = args.pop("driver"), args.pop("address")
    settings = Settings(driver=name, address=address)

    def start() -> closing[RobotDriver]:
        return closing(load_driver(settings, MemoryBus(MemoryHub())))

    again = start if args.pop("start_twice") else None
    try:
        driver = load_driver(settings, MemoryBus(MemoryHub()))
        chosen.rig = Rig(driver, **args, started_again=again)
    except HeliosError as error:
        print(f"helios-contract: {error.message}", file=sys.stderr)
        return 2
    alone = ["-c", os.devnull, "--rootdir", str(Path.cwd()), "-p", "no:cacheprovider"]
    shown = ["-v", "-rfEs", "--no-header"]  # with why a claim was skipped
    return int(pytest.main([*alone, *shown, str(ANY_DRIVER), *argv[at + 1 :]]))


if __name__ == "__main__":
    sys.exit(main())
