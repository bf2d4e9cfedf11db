"""Golden record of one short episode: no change that only saves time may change a result.

Floating-point results depend on the processor and on the versions of MuJoCo, Mesa, NumPy and the
compiler of the kernels. So each golden hash belongs to one combination of them, and the test is
skipped on any other. If a change of results is wanted, or to add your machine, run

    python -m pytest tests/unit/eval/test_episode_golden.py -rs

on a commit that you trust, and copy the printed line into `GOLDEN`.
"""

from __future__ import annotations

import hashlib
import json
from importlib.metadata import version

import llvmlite.binding as llvm
import mujoco
import pytest
from helios_eval.episodes.episode_player import PlayedEpisode, play
from helios_eval.episodes.episode_spec import DEFAULT_SCORER, SCORER, EpisodeSpec, noise_of

STEPS = 40
TIMES = {"wall_s", "step_ms", "cpu_s", "stage_ms"}
PACKAGES = ("mujoco", "numpy", "numba", "opencv-python-headless", "scipy")

SOFTWARE = (
    "llvmpipe (LLVM 15.0.6, 256 bits), mujoco 3.17.0 numpy 2.4.6 numba 0.68.1 "
    "opencv-python-headless 5.0.0.93 scipy 1.17.1"
)
GOLDEN = {
    f"znver3, {SOFTWARE}": "b35f03969a6fd50f",
    f"znver4, {SOFTWARE}": "b35f03969a6fd50f",
    f"znver5, {SOFTWARE}": "b35f03969a6fd50f",
}


def machine() -> str:
    """Everything that floating-point results are known to depend on."""
    gl = mujoco.GLContext(8, 8)
    gl.make_current()
    try:
        from OpenGL import GL

        name = GL.glGetString(GL.GL_RENDERER)
        assert name is not None
        renderer = name.decode()
    finally:
        gl.free()
    packages = " ".join(f"{name} {version(name)}" for name in PACKAGES)
    return f"{llvm.get_host_cpu_name()}, {renderer}, {packages}"


def digest(played: PlayedEpisode) -> str:
    """Hash of the record, and of the trajectory and the maps in the failure's snapshot."""
    facts = json.dumps(played.record.model_dump(exclude=TIMES), default=str, sort_keys=True)
    out = hashlib.sha256(facts.encode())
    assert played.snapshot is not None
    out.update(played.snapshot.trajectory_m.tobytes())
    out.update(played.snapshot.occupancy.tobytes())
    out.update(repr(played.snapshot.beliefs).encode())
    return out.hexdigest()[:16]


def test_a_short_episode_has_its_golden_record() -> None:
    here, noise = machine(), noise_of("ovmm-v1", 1.0, None)
    settings = {"max_steps": STEPS, SCORER: DEFAULT_SCORER}
    asked = EpisodeSpec("ovmm", "helios", "noisy", "ovmm-v1", 200, noise, settings)
    found = digest(play(asked, ""))
    if here not in GOLDEN:
        pytest.skip(f"no golden record of this machine; add {here!r}: {found!r}")
    assert found == GOLDEN[here]
