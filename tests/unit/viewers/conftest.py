"""A recording with every channel, for all tests of viewers."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.unit.viewers.viewed_robot import recording


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File of the recording."""
    return recording(tmp_path_factory.mktemp("recorded"))
