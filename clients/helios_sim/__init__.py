"""Simulator: homes generated from a seed, physics, ground truth, metrics and the robot driver."""

import os
import sys

# Without a display MuJoCo renders through EGL; it reads the variable when first imported.
if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")
