"""The renderers by name."""

from __future__ import annotations

from typing import Literal

from helios_objectmap.rendering import splat
from helios_objectmap.rendering.renderer import Project

BackEnd = Literal["cpu", "cuda"]


def back_end(name: BackEnd) -> Project:
    """The back end of a name. Raises Unavailable, saying what to install, where it can't run."""
    if name == "cuda":
        from helios_objectmap.rendering import splat_cuda  # loads torch only when chosen

        splat_cuda.require()
        return splat_cuda.project
    return splat.project
