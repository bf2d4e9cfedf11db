"""`helios view --rerun`: Rerun's own reader finds rows in every entity, from a file and from a
server."""

from __future__ import annotations

import os
import socket
import subprocess
import threading
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest

from tests.support import ENDS_WITHIN_S, free_port, wait_until
from tests.unit.viewers.viewed_robot import say_of, start_view

pytest.importorskip("rerun", reason="pip install 'helios-ovmm[rerun]'")

MAP_ENTITIES = {
    "occupancy", "value/pick", "obstacles", "gaussians", "objects/boxes", "frontiers/spheres",
    "trajectory/lines", "candidates/spheres", "plan/lines", "plan/arrows", "path",
}  # fmt: skip
ENTITIES = {
    "/world", "/world/robot", "/world/robot/heading", "/world/camera", "/world/camera/color",
    "/world/camera/depth", "/world/camera/detections", "/world/keyframe", "/world/keyframe/color",
    "/world/keyframe/depth", "/log/task", "/log/decision", "/task", "/decision",
    *(f"/world/map/{name}" for name in MAP_ENTITIES),
}  # fmt: skip


def rows_of(path: Path) -> Counter[str]:
    """Number of rows of each entity in an .rrd file, as Rerun reads it; empty if unreadable."""
    from rerun.chunk import RrdReader

    out: Counter[str] = Counter()
    with suppress(ValueError, RuntimeError, OSError):
        for chunk in RrdReader(path).stream():
            out[chunk.entity_path] += chunk.num_rows
    return out


def test_every_entity_of_a_saved_file_has_rows(recorded: Path, tmp_path: Path) -> None:
    out = tmp_path / "view.rrd"
    code, said = say_of(str(recorded), "--rerun", "--save", str(out))
    assert code == 0, said
    rows = rows_of(out)
    assert rows.keys() >= ENTITIES
    assert rows["/world/keyframe/color"] == 3  # of the recording
    assert rows["/decision"] == 3


@pytest.mark.parametrize("earlier", ["an older file", None])
def test_a_file_is_left_alone_if_nothing_can_be_shown(
    earlier: str | None, recorded: Path, tmp_path: Path
) -> None:
    out = tmp_path / "view.rrd"
    if earlier is not None:
        out.write_text(earlier)
    nobody = f"tcp/127.0.0.1:{free_port()}"
    assert say_of("--rerun", "--save", str(out), "--router", nobody)[0] == 1
    with socket.socket() as taken:  # fails after the file is opened
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        foxglove = ("--foxglove", "--foxglove-port", str(taken.getsockname()[1]))
        assert say_of(str(recorded), "--rerun", "--save", str(out), *foxglove)[0] == 1
    left = {path: path.read_text() for path in tmp_path.iterdir()}
    assert left == ({} if earlier is None else {out: earlier})


def test_a_pipe_is_written_directly(recorded: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.rrd"
    os.mkfifo(pipe)
    threading.Thread(target=pipe.read_bytes, daemon=True).start()
    assert say_of(str(recorded), "--rerun", "--save", str(pipe))[0] == 0
    assert pipe.is_fifo()


@pytest.mark.parametrize(
    ("name", "words"), [(".", "is a folder; name a file in it"), ("none/x.rrd", "no folder")]
)
def test_a_file_that_cannot_be_written_is_reported(
    name: str, words: str, recorded: Path, tmp_path: Path
) -> None:
    code, said = say_of(str(recorded), "--rerun", "--save", str(tmp_path / name))
    assert (code, said.count("\n")) == (1, 1)
    assert words in said


def test_the_gaussians_are_splats_with_colour_and_size(recorded: Path, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    out = tmp_path / "view.rrd"
    assert say_of(str(recorded), "--rerun", "--save", str(out))[0] == 0
    chunks = [c for c in RrdReader(out).stream() if c.entity_path == "/world/map/gaussians"]
    batch = chunks[-1].to_record_batch()
    named = {
        name.rpartition(":")[2]: batch.column(name)[-1].as_py()
        for name in batch.schema.names
        if "GaussianSplats3D" in name
    }
    assert named["centers"] == [[0, 0, 0], [1, 1, 1], [2, 2, 2]]
    assert named["scales"][0] == pytest.approx([0.01] * 3)
    assert named["colors"] == [0xC8C8C880] * 3  # RGB 200, opacity 0.5


def test_a_receiver_of_the_server_gets_every_entity(recorded: Path, tmp_path: Path) -> None:
    """The receiver is Rerun's program, which stores what the server sends."""
    from helios_viewers.rerun_server import program

    port, out = free_port(), tmp_path / "received.rrd"
    flags = ("--rerun-port", str(port), "--web-port", str(free_port()))
    process = start_view(str(recorded), "--rerun", *flags, stderr=subprocess.PIPE)
    receiver: subprocess.Popen[bytes] | None = None
    try:
        assert process.stderr is not None
        while "has all of" not in (said := process.stderr.readline()):
            assert said, "it has ended"
        receiver = subprocess.Popen(
            [program(), f"rerun+http://127.0.0.1:{port}/proxy", "--save", out, "--port", "auto"],
            env=os.environ | {"CI": "true"},
            stderr=subprocess.DEVNULL,
        )
        wait_until(lambda: rows_of(out).keys() >= ENTITIES, 60, "every entity has arrived")
    finally:
        process.terminate()
        assert process.wait(ENDS_WITHIN_S) == 0
        if receiver is not None:
            receiver.terminate()
            receiver.wait(ENDS_WITHIN_S)
