"""The renderers by name."""

from __future__ import annotations

from typing import Literal

from helios_objectmap.rendering import cpu
from helios_objectmap.rendering.renderer import Project

BackEnd = Literal["cpu", "cuda"]


def back_end(name: BackEnd) -> Project:
    """The back end of a name. Raises Unavailable, saying what to install, where it can't run."""
    if name == "cuda":
        from helios_objectmap.rendering import cuda  # loads torch only when chosen

        cuda.require()
        return cuda.project
    return cpu.project
