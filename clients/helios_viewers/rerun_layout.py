"""Layout of Rerun's viewer: images on the left, the world in 3D, tasks and decisions on the right.

`python -m helios_viewers.rerun_layout` writes it to deploy/viewers.
"""

from __future__ import annotations

from pathlib import Path

import rerun.blueprint as rrb

from helios_viewers.rerun_entities import CAMERA, KEYFRAME, MAP, WORLD

APPLICATION = "helios"
TIMELINE = "time"  # time of the recorder's clock
EYE = rrb.EyeControls3D(position=(-3.0, -7.0, 9.0), look_target=(2.0, 0.0, 0.0))  # m, from above
WITHOUT_DEPTH = [f"- /{CAMERA}/depth/**", f"- /{KEYFRAME}/**"]  # the depth would cover the maps


def layout() -> rrb.Blueprint:
    """The layout that `helios view --rerun` sends, and that deploy/viewers has as a file."""
    images = rrb.Vertical(
        rrb.Spatial2DView(
            origin=CAMERA, contents=[f"+ /{CAMERA}/**", f"- /{CAMERA}/depth/**"], name="Camera"
        ),
        rrb.Tabs(
            rrb.Spatial2DView(
                origin=KEYFRAME, contents=[f"+ /{KEYFRAME}/depth"], name="Keyframe: depth"
            ),
            rrb.Spatial2DView(
                origin=KEYFRAME, contents=[f"+ /{KEYFRAME}/color"], name="Keyframe: colour"
            ),
        ),
        rrb.TimeSeriesView(origin="timing", name="Updates of the maps (ms)"),
    )
    worlds = rrb.Tabs(
        rrb.Spatial3DView(
            origin=WORLD, name="World", eye_controls=EYE, line_grid=False,
            contents=[f"+ /{WORLD}/**", *WITHOUT_DEPTH, f"- /{MAP}value/**",
                      f"- /{MAP}obstacles", f"- /{MAP}path"],
        ),
        rrb.Spatial3DView(
            origin=WORLD, name="Values", eye_controls=EYE, line_grid=False,
            contents=[f"+ /{WORLD}/**", *WITHOUT_DEPTH, f"- /{MAP}occupancy",
                      f"- /{MAP}gaussians", f"- /{MAP}path"],
        ),
    )  # fmt: skip
    texts = rrb.Vertical(
        rrb.TextDocumentView(origin="task", name="Task"),
        rrb.TextDocumentView(origin="decision", name="Decision"),
        rrb.TextLogView(origin="log", name="Log"),
        row_shares=[1, 2, 2],
    )
    return rrb.Blueprint(
        rrb.Horizontal(images, worlds, texts, column_shares=[2, 4, 2]),
        rrb.TimePanel(timeline=TIMELINE, play_state="following", state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


if __name__ == "__main__":
    layout().save(APPLICATION, Path("deploy/viewers/rerun-layout.rbl"))
