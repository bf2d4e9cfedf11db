"""The depth back end `transformers:<model id or folder>`: metric depth from colour alone.

Depth Pro outputs an inverse depth for an image of one canonical width and an estimate of the field
of view. The focal length converts this to metres: depth = focal / (width * inverse). The other
models output metres of an indoor camera directly.
"""

from __future__ import annotations

import math

import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_detector.backend import DepthBackend, DepthEstimate
from helios_detector.hf.model_runtime import HfModel, Placement, config_of, picture, source_of

SETTING = "depth"
FARTHEST_M = 65.0  # limit of 16-bit millimetres; larger depth is invalid
FOCAL = ("calibrated", "own")


class HfDepth(DepthBackend):
    """A monocular model of metric depth."""

    def __init__(self, spec: str, placement: Placement, focal: str = "calibrated") -> None:
        """Raises Unavailable (library, folder, hub) or InvalidInput (no metric depth)."""
        if focal not in FOCAL:
            raise InvalidInput(f"depth_focal is {focal!r}; set one of {', '.join(FOCAL)}")
        source = source_of(spec, SETTING)
        config = config_of(source, SETTING)
        self._kind = config.model_type
        metric = self._kind in ("depth_pro", "zoedepth", "glpn") or (
            self._kind == "depth_anything" and config.depth_estimation_type == "metric"
        )
        if not metric:
            raise InvalidInput(
                f"{source} is a {self._kind!r} model that gives no metres; set {SETTING} to a "
                "Depth Pro, or a Depth Anything whose name says Metric-Indoor"
            )
        self._guesses = self._kind == "depth_pro" and bool(config.use_fov_model)
        if focal == "own" and not self._guesses:
            raise InvalidInput(
                f"depth_focal is own and {source} guesses no focal length; set it to calibrated, "
                "or use a Depth Pro"
            )
        self._own = focal == "own"
        self._model = HfModel(
            source, SETTING, placement, "AutoModelForDepthEstimation", "AutoImageProcessor"
        )
        self.name = spec

    def warm_up(self) -> None:
        self.estimate(np.full((240, 320, 3), 114, np.uint8), 300.0)

    def unload(self) -> None:
        self._model.unload()

    def accelerator_mb(self) -> float:
        return self._model.accelerator_mb()

    def close(self) -> None:
        self.unload()

    def estimate(self, color: NDArray[np.uint8], focal_px: float | None) -> DepthEstimate:
        """Depth [h, w] in metres of an RGB image [h, w, 3]; 0 beyond 65 m or where invalid.

        `focal_px` is the calibrated focal length in pixels of this image; with depth_focal=own the
        model's estimate replaces it. Raises InvalidInput when a required focal length is missing or
        an estimate is implausible, Unavailable or Internal when the model cannot work.
        """
        height, width = color.shape[:2]
        if focal_px is None and not self._guesses:
            raise InvalidInput(
                f"the image came without a calibration and {self.name} guesses no focal length; "
                "send K, or set depth to a Depth Pro"
            )
        calibrated = None if self._own else focal_px
        with self._model.use() as (model, processor):
            import torch

            inputs = processor(images=picture(color), return_tensors="pt")
            out = model(**self._model.to_device(inputs))
            sizes = [(height, width)]
            if self._kind == "depth_pro":
                if calibrated is not None:
                    degrees = 2 * math.degrees(math.atan(0.5 * width / calibrated))
                    out.field_of_view = torch.tensor([degrees], device=out.predicted_depth.device)
                elif not 1 < float(out.field_of_view) < 179:
                    raise InvalidInput(
                        f"{self.name} guesses a field of view of {float(out.field_of_view):.0f} "
                        "degrees for this image; send a calibration, or set depth_focal to "
                        "calibrated"
                    )
                out.field_of_view = out.field_of_view.float()
            out.predicted_depth = out.predicted_depth.float()
            extra = {"source_sizes": sizes} if self._kind == "zoedepth" else {}
            got = processor.post_process_depth_estimation(out, target_sizes=sizes, **extra)[0]
            depth_m = got["predicted_depth"].float().cpu().numpy().reshape(height, width)
            own = got.get("focal_length")
        good = np.isfinite(depth_m) & (depth_m > 0) & (depth_m <= FARTHEST_M)
        used = calibrated or (float(own) if own is not None else focal_px)
        assert used is not None  # ensured by the check at the top
        return DepthEstimate(np.where(good, depth_m, 0).astype(np.float32), float(used))
