"""The store: a growable structure of arrays, one row a Gaussian."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NO_INSTANCE = 0
OTHER = -1
_FIELDS = (
    "means",
    "radius_m",
    "opacity",
    "color",
    "positive",
    "asked",
    "born",
    "believed",
    "instance",
)


class GaussianStore:
    """Gaussians in the world frame with their evidence per class name.

    The properties are views of the rows in use; they are valid until rows are added or removed.
    """

    def __init__(self) -> None:
        self.class_names: list[str] = []
        self._n = 0
        self._means = np.empty((0, 3), np.float32)
        self._radius_m = np.empty(0, np.float32)
        self._opacity = np.empty(0, np.float32)
        self._color = np.empty((0, 3), np.uint8)
        self._positive = np.empty((0, 0), np.float32)
        self._asked = np.empty((0, 0), np.float32)
        self._born = np.empty(0, np.int64)
        self._believed = np.empty(0, np.int16)
        self._instance = np.empty(0, np.int32)

    def __len__(self) -> int:
        return self._n

    @property
    def means(self) -> NDArray[np.float32]:
        """[n, 3] world, metres."""
        return self._means[: self._n]

    @property
    def radius_m(self) -> NDArray[np.float32]:
        """[n] standard deviation of the isotropic Gaussian, metres."""
        return self._radius_m[: self._n]

    @property
    def opacity(self) -> NDArray[np.float32]:
        """[n] in (0, 1)."""
        return self._opacity[: self._n]

    @property
    def color(self) -> NDArray[np.uint8]:
        """[n, 3] RGB."""
        return self._color[: self._n]

    @property
    def positive(self) -> NDArray[np.float32]:
        """[n, classes] evidence for each class, in units of alpha_cpa times kappa."""
        return self._positive[: self._n]

    @property
    def asked(self) -> NDArray[np.float32]:
        """[n, classes] all evidence of the views in which the class was asked for."""
        return self._asked[: self._n]

    @property
    def born(self) -> NDArray[np.int64]:
        """[n] number of the update that made the Gaussian."""
        return self._born[: self._n]

    @property
    def believed(self) -> NDArray[np.int16]:
        """[n] column of the most likely class, or OTHER."""
        return self._believed[: self._n]

    @property
    def instance(self) -> NDArray[np.int32]:
        """[n] label of the instance, or NO_INSTANCE."""
        return self._instance[: self._n]

    def column(self, class_name: str) -> int:
        """Column of a class name; a new name gets a new column without evidence."""
        if class_name not in self.class_names:
            self.class_names.append(class_name)
            empty = np.zeros((len(self._means), 1), np.float32)
            self._positive = np.concatenate([self._positive, empty], axis=1)
            self._asked = np.concatenate([self._asked, empty], axis=1)
        return self.class_names.index(class_name)

    def append(
        self,
        means: NDArray[np.float32],
        radius_m: NDArray[np.float32],
        opacity: float,
        color: NDArray[np.uint8],
        born: int,
    ) -> slice:
        """Add Gaussians without evidence; returns their rows."""
        first, n = self._n, self._n + len(means)
        if n > len(self._means):
            self._grow(max(n, 2 * len(self._means), 1024))
        self._n = n
        rows = slice(first, n)
        self._means[rows] = means
        self._radius_m[rows] = radius_m
        self._opacity[rows] = opacity
        self._color[rows] = color
        self._positive[rows] = 0
        self._asked[rows] = 0
        self._born[rows] = born
        self._believed[rows] = OTHER
        self._instance[rows] = NO_INSTANCE
        return rows

    def remove(self, rows: NDArray[np.integer]) -> None:
        """Remove rows; the others keep their order."""
        if not len(rows):
            return
        keep = np.ones(self._n, bool)
        keep[rows] = False
        first = int(np.min(rows))  # rows before it stay where they are
        n = int(keep.sum())
        for name in _FIELDS:
            array = getattr(self, f"_{name}")
            array[first:n] = array[first : self._n][keep[first:]]
        self._n = n

    def _grow(self, capacity: int) -> None:
        for name in _FIELDS:
            old = getattr(self, f"_{name}")
            new = np.empty((capacity, *old.shape[1:]), old.dtype)
            new[: self._n] = old[: self._n]
            setattr(self, f"_{name}", new)
