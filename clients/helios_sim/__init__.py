"""The simulated world: homes by seed, physics, truth and metrics, and its robot driver."""

import os
import sys

# Without a display MuJoCo has to be told of EGL before it is first imported.
if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")
