"""Fixtures: a fake Spot for each test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("bosdyn.client", reason="pip install 'helios-ovmm[spot]'")

if TYPE_CHECKING:
    from tests.unit.spot.spot_stage import Stage

Staging = Callable[..., "Stage"]


@pytest.fixture
def staging(tmp_path: Path) -> Iterator[Staging]:
    """Makes stages and closes them at the end of the test."""
    from tests.unit.spot.spot_stage import Stage

    made: list[Stage] = []

    def make(**values: Any) -> Stage:
        folder = tmp_path / str(len(made))
        folder.mkdir()
        made.append(Stage(folder, **values))
        return made[-1]

    yield make
    for stage in made:
        stage.close()


@pytest.fixture
def stage(staging: Staging) -> Stage:
    """A stage without faults; the robot walks eight times as fast as commanded."""
    return staging()
