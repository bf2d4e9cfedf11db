"""Placement of labels near their objects, without overlap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

Rect = tuple[float, float, float, float]  # left, top, right, bottom; pixels, y downwards

GAP_PX = 4
RINGS = 7  # number of distances from the object to try, a label's height apart


@dataclass(frozen=True)
class Wanted:
    """Size of a label, and the box of its object."""

    width_px: float
    height_px: float
    box_px: Rect


def placed(
    wanted: Sequence[Wanted], size_px: tuple[int, int], taken: Sequence[Rect] = ()
) -> list[Rect | None]:
    """Places of the labels, assigned in the given order; None for a label without room.

    size_px: width and height of the picture. taken: areas to keep free.
    """
    full = list(taken)
    out: list[Rect | None] = []
    for label in wanted:
        inside = (place for place in _places(label) if _within(place, size_px))
        found = next((p for p in inside if not any(_overlap(p, other) for other in full)), None)
        if found is not None:
            full.append(found)
        out.append(found)
    return out


def lead(place: Rect, box: Rect) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Leader line from a label to the centre of its object; None if the label is close to it."""
    near = (
        place[0] - 3 * GAP_PX,
        place[1] - 3 * GAP_PX,
        place[2] + 3 * GAP_PX,
        place[3] + 3 * GAP_PX,
    )
    if _overlap(near, box):
        return None
    u, v = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    return (min(max(u, place[0]), place[2]), min(max(v, place[1]), place[3])), (u, v)


def _places(label: Wanted) -> Iterator[Rect]:
    """Places to try, best first: above, below, beside, then the same at greater distances."""
    left, top, right, bottom = label.box_px
    width, height = label.width_px, label.height_px
    middle_u, middle_v = (left + right - width) / 2, (top + bottom - height) / 2
    for ring in range(RINGS):
        off = GAP_PX + ring * (height + 2)
        corners = [
            *((u, top - off - height) for u in (left, right - width, middle_u)),
            *((u, bottom + off) for u in (left, right - width, middle_u)),
            *((right + off, middle_v + shift) for shift in (0, -off, off)),
            *((left - off - width, middle_v + shift) for shift in (0, -off, off)),
        ]
        for u, v in corners:
            yield u, v, u + width, v + height


def _within(place: Rect, size_px: tuple[int, int]) -> bool:
    return place[0] >= 0 and place[1] >= 0 and place[2] <= size_px[0] and place[3] <= size_px[1]


def _overlap(a: Rect, b: Rect) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
