"""Where in space the rows are: cubes of half a metre, and which of them a view can see."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.store.rows import RowGroups
from helios_objectmap.view import View

BLOCK_M = 0.5
_BITS = 21
_HALF = 1 << (_BITS - 1)


class Blocks:
    """The block of each row. A block without rows may give its number to another one."""

    def __init__(self) -> None:
        self.rows = RowGroups()
        self._number: dict[int, int] = {}  # key of a block -> its group in `rows`
        self._highest = 0  # number given so far
        self._free: list[int] = []  # numbers below it that no block has
        self._center_m = np.empty((16, 3))  # by number; 0 is no block

    def add(self, rows: NDArray[np.integer], means: NDArray[np.float32]) -> None:
        """Rows [k] are now at means [k, 3] in the world."""
        if not len(rows):
            return
        ijk = np.floor(means.astype(np.float64) / BLOCK_M).astype(np.int64)
        keys, first, of_row = np.unique(_keys(ijk), return_index=True, return_inverse=True)
        self._make_room(len(keys))
        numbers = np.empty(len(keys), np.int32)
        for k, (key, i) in enumerate(zip(keys.tolist(), first.tolist(), strict=True)):
            number = self._number.get(key)
            if number is None:
                number = self._number[key] = self._new_number()
                self._center_m[number] = (ijk[i] + 0.5) * BLOCK_M
            numbers[k] = number
        self.rows.move(rows, numbers[of_row])

    def seen_by(self, view: View, far_m: float, margin_m: float) -> NDArray[np.int32]:
        """Rows of the blocks that a view may show: all within margin_m of its pyramid, and more.

        far_m: nothing farther along the optical axis is wanted.
        """
        center = (
            self._center_m[1 : self._highest + 1] @ view.T_cam_world[:3, :3].T
            + view.T_cam_world[:3, 3]
        )
        x, y, z = center.T
        reach = BLOCK_M * np.sqrt(3) / 2 + margin_m
        inside = (z > -reach) & (z < far_m + reach)
        # The four side planes go through the eye: (normal . center) >= -reach.
        left, right = -(view.cx + 0.5) / view.fx, (view.width - 0.5 - view.cx) / view.fx
        up, down = -(view.cy + 0.5) / view.fy, (view.height - 0.5 - view.cy) / view.fy
        inside &= (x - left * z) >= -reach * np.hypot(1, left)
        inside &= (right * z - x) >= -reach * np.hypot(1, right)
        inside &= (y - up * z) >= -reach * np.hypot(1, up)
        inside &= (down * z - y) >= -reach * np.hypot(1, down)
        return self.rows.rows_of(np.flatnonzero(inside) + 1)

    def near(self, means: NDArray[np.float32], reach_m: float) -> NDArray[np.int32]:
        """Rows that are within reach_m of some of the points [k, 3] along every axis, and more."""
        if not len(means):
            return np.empty(0, np.int32)
        ijk = np.unique(np.floor(means.astype(np.float64) / BLOCK_M).astype(np.int64), axis=0)
        steps = range(-math.ceil(reach_m / BLOCK_M), math.ceil(reach_m / BLOCK_M) + 1)
        offsets = np.array(list(itertools.product(steps, repeat=3)))
        around = np.unique(_keys(ijk[:, None] + offsets))
        found = (self._number.get(key) for key in around.tolist())
        return self.rows.rows_of(np.array([n for n in found if n is not None], np.int64))

    def _make_room(self, blocks: int) -> None:
        """For so many new ones: first the numbers of blocks without rows, then a larger table."""
        if self._highest + blocks - len(self._free) < len(self._center_m):
            return
        for key, number in list(self._number.items()):
            if not self.rows.count_of(number):
                del self._number[key]
                self._free.append(number)
        # Half of it stays free, so that it is rare.
        while self._highest + blocks - len(self._free) >= len(self._center_m) // 2:
            self._center_m = np.concatenate([self._center_m, self._center_m])

    def _new_number(self) -> int:
        if self._free:
            return self._free.pop()
        self._highest += 1
        return self._highest


def _keys(ijk: NDArray[np.int64]) -> NDArray[np.int64]:
    """One integer per block [..., 3]; the map reaches 2^20 blocks from the origin."""
    shifted = ijk + _HALF
    return (shifted[..., 0] << (2 * _BITS)) | (shifted[..., 1] << _BITS) | shifted[..., 2]
