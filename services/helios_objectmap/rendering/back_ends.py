"""Table of the renderers by name."""

from __future__ import annotations

from typing import Literal

from helios_objectmap.rendering import cpu
from helios_objectmap.rendering.renderer_interface import Project

BackEnd = Literal["cpu", "cuda"]


def back_end(name: BackEnd) -> Project:
    """Renderer of that name. Raises Unavailable, with what to install, if it cannot run here."""
    if name == "cuda":
        from helios_objectmap.rendering import cuda  # imported here: it loads torch

        cuda.require()
        return cuda.project
    return cpu.project
