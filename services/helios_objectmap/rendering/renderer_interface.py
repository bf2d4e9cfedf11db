"""Interface of a renderer of Gaussians, on CPU or GPU (section 3.1.3, eq. 1).

    alpha_n(p) = opacity_n * exp(-0.5 d^T S_n^-1 d),  d = p - mean of the splat in the image
    kappa(p, n) = alpha_n(p) * prod_{j nearer than n} (1 - alpha_j(p))                   (eq. 1)

The printed kernel lacks the minus sign. S_n is the EWA covariance of a sphere of `radius` plus
LOW_PASS_PX2. An alpha below 1/255 counts as 0, an opacity above 0.999 counts as 0.999, and a
renderer may finish a pixel once less than 1e-4 of its light is left.

A back end is one function, `Project`: `cpu.project`, or `cuda.project` on a GPU; `back_ends.py`
selects one by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.camera import View

LOW_PASS_PX2 = 0.3  # as in 3DGS, so that no splat falls between two pixels
NEAR_M = 0.05
FAR_M = 100.0

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Rendering:
    """Depth, coverage and features of the Gaussians, rendered into one view."""

    depth_m: Float32  # [h, w] blended depth along the optical axis, 0 without coverage
    coverage: Float32  # [h, w] sum of kappa, in [0, 1]
    features: Float32  # [c, h, w] sums of kappa * feature, not divided by the coverage


class Projection(Protocol):
    """Gaussians projected into one view: those that touch the image."""

    @property
    def rows(self) -> NDArray[np.int32]:
        """Indices [k] of the Gaussians."""
        ...

    @property
    def depth_m(self) -> Float32:
        """Distances [k] along the optical axis."""
        ...

    @property
    def uv(self) -> Float32:
        """Projected centres [k, 2] in pixels."""
        ...

    def render(self, features: Float32 | None = None) -> Rendering:
        """Blend depth and, if given, features [k, c] of the rows over the image (eq. 1)."""
        ...

    def kappa_sums(self, labels: NDArray[np.int32], n_labels: int) -> Float32:
        """Sum kappa(p, n) over the pixels of each label: the sum of eq. 3, [k, n_labels].

        labels: [h, w]; pixels with a negative label are left out.
        """
        ...

    def renewed(self, gone: NDArray[np.integer], more: Self) -> Self:
        """This projection without the Gaussians `gone`, plus those of `more` in the same view.

        gone: distinct indices into `rows`. The result equals a projection of all remaining
        Gaussians and all of `more`. `more` may contain a Gaussian of this projection only if it is
        in `gone`.
        """
        ...


class Project(Protocol):
    """Back end: function that projects Gaussians into a view."""

    def __call__(
        self,
        means: Float32,
        radius_m: Float32,
        opacity: Float32,
        view: View,
        rows: NDArray[np.int32] | None = None,
        far_m: float = FAR_M,
    ) -> Projection:
        """Project Gaussians into a view and order them by depth.

        means: [n, 3] world, metres; radius_m, opacity: [n]; rows: the ones to project, default all.
        Drawn attributes order equal depths, so the order of the rows never changes a pixel.
        """
        ...
