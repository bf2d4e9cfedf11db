"""Gaussians as a growable structure of arrays, one row each, and the limit of their number."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.camera import View
from helios_objectmap.spatial_index import NO_GROUP, Blocks, RowGroups
from helios_objectmap.viewpoint_weights import NEVER

NO_INSTANCE = NO_GROUP
OTHER = -1
# Field of a row -> its name in a map file.
_FIELDS = {
    "means": "means",
    "radius_m": "radius_m",
    "opacity": "opacity",
    "color": "color",
    "class_evidence": "positive",
    "total_evidence": "asked",
    "votes": "votes",
    "created_update": "born",
    "class_column": "believed",
    "seen_through_views": "through",
    "seen_through_viewpoint": "through_from",
    "last_seen_update": "seen",
}
KEPT = 0.9


@dataclass(frozen=True)
class InstanceGaussians:
    """Gaussians for a display or a planner; row i of every array is the same Gaussian."""

    means: NDArray[np.float32]  # [n, 3] world, metres
    radius_m: NDArray[np.float32]  # [n] standard deviation
    opacity: NDArray[np.float32]  # [n]
    color: NDArray[np.uint8]  # [n, 3] RGB
    instance: NDArray[np.int32]  # [n] instance id, 0 for none
    class_names: tuple[str, ...]  # "other" first
    concentration: NDArray[np.float32]  # [n, classes] Dirichlet parameters


class GaussianStore:
    """Gaussians in the world frame with their evidence per class name.

    The properties are views of the rows in use, valid until rows are added or removed. Removal
    moves the last rows into the gaps, so a row number does not identify a Gaussian.
    """

    def __init__(self, sectors: int = 0) -> None:
        """sectors: viewing sectors per Gaussian for which votes are kept; 0 keeps none."""
        self.class_names: list[str] = []
        self.blocks = Blocks()  # block of each row
        self.instances = RowGroups()  # instance label of each row; NO_INSTANCE for none
        self._n = 0
        self._means = np.empty((0, 3), np.float32)
        self._radius_m = np.empty(0, np.float32)
        self._opacity = np.empty(0, np.float32)
        self._color = np.empty((0, 3), np.uint8)
        self._class_evidence = np.empty((0, 0), np.float32)
        self._total_evidence = np.empty((0, 0), np.float32)
        self._votes = np.empty((0, 0, sectors, 2), np.uint16)
        self._created_update = np.empty(0, np.int64)
        self._class_column = np.empty(0, np.int16)
        self._in_core = np.empty(0, np.bool_)
        self._seen_through_views = np.empty(0, np.float32)
        self._seen_through_viewpoint = np.empty(0, np.int32)
        self._last_seen_update = np.empty(0, np.int64)
        self._widest_m = 0.0

    def __len__(self) -> int:
        return self._n

    @property
    def means(self) -> NDArray[np.float32]:
        """Centres [n, 3] in the world, metres."""
        return self._means[: self._n]

    @property
    def radius_m(self) -> NDArray[np.float32]:
        """Standard deviation [n] of the isotropic Gaussian, metres."""
        return self._radius_m[: self._n]

    @property
    def opacity(self) -> NDArray[np.float32]:
        """Opacity [n] in (0, 1)."""
        return self._opacity[: self._n]

    @property
    def color(self) -> NDArray[np.uint8]:
        """RGB colour [n, 3]."""
        return self._color[: self._n]

    @property
    def class_evidence(self) -> NDArray[np.float32]:
        """Evidence [n, classes] for each class, in units of alpha_cpa times kappa."""
        return self._class_evidence[: self._n]

    @property
    def total_evidence(self) -> NDArray[np.float32]:
        """All evidence [n, classes] of the views that searched for the class."""
        return self._total_evidence[: self._n]

    @property
    def votes(self) -> NDArray[np.uint16]:
        """Votes [n, classes, sectors, 2] from each sector: for the class, and all."""
        return self._votes[: self._n]

    @property
    def created_update(self) -> NDArray[np.int64]:
        """Number [n] of the update that created the Gaussian."""
        return self._created_update[: self._n]

    @property
    def class_column(self) -> NDArray[np.int16]:
        """Column [n] of the most likely class, or OTHER."""
        return self._class_column[: self._n]

    @property
    def in_core(self) -> NDArray[np.bool_]:
        """True [n] in the core of an instance, False with faint evidence."""
        return self._in_core[: self._n]

    @property
    def seen_through_views(self) -> NDArray[np.float32]:
        """Number [n] of distinct views that saw through the Gaussian since a view last saw it."""
        return self._seen_through_views[: self._n]

    @property
    def seen_through_viewpoint(self) -> NDArray[np.int32]:
        """Viewpoint [n] that last saw through it, or NEVER."""
        return self._seen_through_viewpoint[: self._n]

    @property
    def last_seen_update(self) -> NDArray[np.int64]:
        """Number [n] of the last update that saw the Gaussian."""
        return self._last_seen_update[: self._n]

    @property
    def instance(self) -> NDArray[np.int32]:
        """Label [n] of the instance, or NO_INSTANCE. Written by `instances.move`."""
        return self.instances.group[: self._n]

    def arrays(self) -> dict[str, NDArray]:
        """Copies of all data of each row; without votes if none are kept."""
        out = {_FIELDS[name]: getattr(self, name).copy() for name in self._fields}
        return out | {"instance": self.instance.copy()}

    def fill(self, arrays: dict[str, NDArray]) -> None:
        """Load rows from `arrays()` into an empty store whose columns are named already.

        The instances, which index arrays, must be valid. Raises ValueError if shapes or types are
        inconsistent, KeyError if arrays are missing.
        """
        n, classes = len(arrays["means"]), len(self.class_names)
        self._grow(n)
        expected = {_FIELDS[name]: getattr(self, f"_{name}") for name in self._fields}
        for name, like in (expected | {"instance": self.instances.group}).items():
            if arrays[name].shape != (n, *like.shape[1:]) or arrays[name].dtype != like.dtype:
                raise ValueError(
                    f"{name} is {arrays[name].dtype} {arrays[name].shape}; wanted {like.dtype} for "
                    f"{n} Gaussians and {classes} classes"
                )
        for name, array in expected.items():
            array[:n] = arrays[name]
        self._in_core[:n] = True
        self._n = n
        self._widest_m = float(np.max(arrays["radius_m"], initial=0.0))
        self.blocks.add(np.arange(n), self.means)
        self.instances.move(np.arange(n), arrays["instance"])

    def keep_votes(self, sectors: int) -> None:
        """Keep votes from this number of sectors; a change drops the present votes."""
        if sectors != self._votes.shape[2]:
            self._votes = np.zeros((*self._votes.shape[:2], sectors, 2), np.uint16)

    def column(self, class_name: str) -> int:
        """Column of a class name; a new name gets a new column without evidence."""
        if class_name not in self.class_names:
            self.class_names.append(class_name)
            empty = np.zeros((len(self._means), 1), np.float32)
            self._class_evidence = np.concatenate([self._class_evidence, empty], axis=1)
            self._total_evidence = np.concatenate([self._total_evidence, empty], axis=1)
            silent = np.zeros((len(empty), 1, *self._votes.shape[2:]), np.uint16)
            self._votes = np.concatenate([self._votes, silent], axis=1)
        return self.class_names.index(class_name)

    def drop_columns(self, class_names: Iterable[str]) -> None:
        """Remove all evidence for some classes. No row may have one as its most likely class."""
        gone = {self.class_names.index(name) for name in class_names}
        keep = [c for c in range(len(self.class_names)) if c not in gone]
        renumbered = np.full(len(self.class_names) + 1, OTHER, np.int16)  # index -1 is OTHER
        renumbered[keep] = np.arange(len(keep), dtype=np.int16)
        self._class_column[: self._n] = renumbered[self._class_column[: self._n]]
        self._class_evidence = np.ascontiguousarray(self._class_evidence[:, keep])
        self._total_evidence = np.ascontiguousarray(self._total_evidence[:, keep])
        self._votes = np.ascontiguousarray(self._votes[:, keep])
        self.class_names = [self.class_names[c] for c in keep]

    def append(
        self,
        means: NDArray[np.float32],
        radius_m: NDArray[np.float32],
        opacity: float,
        color: NDArray[np.uint8],
        born: int,
    ) -> slice:
        """Add Gaussians without evidence. Returns their rows."""
        first, n = self._n, self._n + len(means)
        if n > len(self._means):
            self._grow(max(n, len(self._means) * 3 // 2, 1024))
        self._n = n
        rows = slice(first, n)
        self._means[rows] = means
        self._radius_m[rows] = radius_m
        self._opacity[rows] = opacity
        self._color[rows] = color
        self._class_evidence[rows] = 0
        self._total_evidence[rows] = 0
        self._votes[rows] = 0
        self._created_update[rows] = born
        self._class_column[rows] = OTHER
        self._in_core[rows] = True
        self._seen_through_views[rows] = 0
        self._seen_through_viewpoint[rows] = NEVER
        self._last_seen_update[rows] = born
        self._widest_m = max(self._widest_m, float(np.max(radius_m, initial=0.0)))
        self.blocks.add(np.arange(first, n), self._means[rows])
        return rows

    def remove(self, rows: NDArray[np.integer]) -> NDArray[np.int32]:
        """Remove rows; the last rows take their numbers. Returns the instances whose rows this
        changes."""
        gone = np.unique(rows)
        n = self._n - len(gone)
        gaps = gone[gone < n]
        last = np.setdiff1d(np.arange(n, self._n), gone, assume_unique=True)
        moved = np.unique(self.instances.group[np.concatenate([gone, last])])
        for groups in (self.blocks.rows, self.instances):
            groups.move(gone, NO_GROUP)
            groups.rename(last, gaps)
        for name in (*_FIELDS, "in_core"):
            array = getattr(self, f"_{name}")
            array[gaps] = array[last]
        self._n = n
        return moved

    def seen_by(self, view: View, far_m: float) -> NDArray[np.int32]:
        """Rows that a view may show, in rising order."""
        return self.blocks.seen_by(view, far_m, 6 * self._widest_m)

    @property
    def _fields(self) -> list[str]:
        """Fields that a file stores."""
        return [name for name in _FIELDS if name != "votes" or self._votes.shape[2]]

    def _grow(self, capacity: int) -> None:
        for name in (*_FIELDS, "in_core"):
            old = getattr(self, f"_{name}")
            new = np.empty((capacity, *old.shape[1:]), old.dtype)
            new[: self._n] = old[: self._n]
            setattr(self, f"_{name}", new)
        self.blocks.rows.grow(capacity)
        self.instances.grow(capacity)


def surplus(believed: NDArray[np.int16], seen: NDArray[np.int64], most: int) -> NDArray[np.intp]:
    """Rows to remove so that at most KEPT * most remain; none while there are at most `most`.

    believed: [n] column of the class, or OTHER; seen: [n] number of the last update that saw it.
    """
    if len(believed) <= most:
        return np.empty(0, np.intp)
    order = np.lexsort((seen, believed != OTHER))
    return order[: len(believed) - int(KEPT * most)]


@njit(cache=True, nogil=True)
def mark_seen_kernel(rows, kappa, seen, update):
    """Set seen [.] to `update` in those of the rows [k] that have some kappa [k, labels]."""
    for k in range(rows.size):
        for c in range(kappa.shape[1]):
            if kappa[k, c] > 0:
                seen[rows[k]] = update
                break
