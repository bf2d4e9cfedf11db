"""Plausibility of a pinhole camera: do its intrinsics fit the size of its image?"""

from __future__ import annotations

from helios_core.geometry import Pinhole
from helios_core.robot_checks.finding import INTRINSICS, Finding, not_measured

FOCAL_SHARE = (0.3, 4.0)  # focal lengths per width of cameras: 118 to 14 degrees wide
LARGEST_ASPECT = 1.15  # between fx and fy
DESCRIBED = 0.05  # share by which an image's focal length may differ from the described one


def intrinsics_finding(camera: Pinhole | None, described: Pinhole | None = None) -> Finding:
    """Finding on the intrinsics of an image; its value is the principal point's offset from the
    middle of the image, in percent of the image's size. described: those in the description."""
    if camera is None:
        return not_measured(INTRINSICS, "no image came")
    across = (camera.cx + 0.5) / camera.width - 0.5
    along = (camera.cy + 0.5) / camera.height - 0.5
    off = 100.0 * max(across, along, key=abs)
    words = _fault(camera, described, off)
    return Finding(
        INTRINSICS.name,
        "wrong" if words else "ok",
        off,
        0.0,
        INTRINSICS.limit,
        INTRINSICS.unit,
        words or "the intrinsics fit the image's size",
    )


def _fault(camera: Pinhole, described: Pinhole | None, off: float) -> str:
    """What is wrong, as one sentence; empty if nothing is."""
    size = f"{camera.width} x {camera.height}"
    if abs(off) > INTRINSICS.limit:
        fits = f"{2 * camera.cx + 1:.0f} x {2 * camera.cy + 1:.0f}"
        return f"the intrinsics fit an image of {fits} pixels, but the image has {size}"
    low, high = FOCAL_SHARE
    if not low <= camera.fx / camera.width <= high:
        return f"a focal length of {camera.fx:.0f} pixels is implausible for an image of {size}"
    aspect = camera.fx / camera.fy
    if not 1 / LARGEST_ASPECT <= aspect <= LARGEST_ASPECT:
        return (
            f"the focal lengths {camera.fx:.0f} and {camera.fy:.0f} pixels differ: the image was "
            "scaled unevenly, or one of them is wrong"
        )
    if described is None:
        return ""
    ratio = (camera.fx / camera.width) / (described.fx / described.width)
    if abs(ratio - 1.0) > DESCRIBED:
        return (
            f"the images' focal length of {camera.fx:.0f} pixels is {100 * abs(ratio - 1):.0f} % "
            f"{'longer' if ratio > 1 else 'shorter'} than the described one"
        )
    return ""
