"""MuJoCo for the modules of the simulator: they import it from here.

MuJoCo loads the OpenGL library that MUJOCO_GL names when it is first imported.
"""

from __future__ import annotations

from helios_core.errors import Unavailable


def no_opengl(error: Exception) -> Unavailable:
    """Error that says why there is no OpenGL, and what to install."""
    return Unavailable(
        f"no OpenGL context ({error}); install libegl1 libegl-mesa0 libgl1-mesa-dri, or "
        "libosmesa6 and set MUJOCO_GL=osmesa"
    )


try:
    import mujoco
except ImportError:  # MuJoCo itself is not installed
    raise
except Exception as error:
    raise no_opengl(error) from error

__all__ = ["mujoco", "no_opengl"]
