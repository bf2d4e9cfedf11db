"""The tutorial docs/tutorials/your-own-robot.md: copy the example driver, check it, break it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from tests.support import python_blocks

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs/tutorials/your-own-robot.md"


def copied_driver(folder: Path) -> Path:
    """Run the commands of the page and return the path of my_robot.py."""
    blocks = re.findall(r"```sh\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (commands,) = (block for block in blocks if "CHECKOUT" in block)
    script = commands.replace("CHECKOUT", str(ROOT))
    subprocess.run(["bash", "-ec", script], cwd=folder, check=True)
    return folder / "my_robot" / "my_robot.py"


def run_contract(driver: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "helios_contract", "my_robot:MyRobot"],
        cwd=driver.parent,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_the_copied_driver_passes_the_contract_suite(tmp_path: Path) -> None:
    done = run_contract(copied_driver(tmp_path))
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr


def test_the_wrong_sign_of_the_page_fails_the_claim_about_turning(tmp_path: Path) -> None:
    driver = copied_driver(tmp_path)
    wrong = python_blocks(PAGE)[0]
    right = wrong.replace("self._yaw_rad - left_rad", "self._yaw_rad + left_rad")
    assert right in driver.read_text()
    driver.write_text(driver.read_text().replace(right, wrong))
    done = run_contract(driver)
    assert done.returncode == 1
    assert "test_a_positive_turn_goes_left_by_that_angle FAILED" in done.stdout
