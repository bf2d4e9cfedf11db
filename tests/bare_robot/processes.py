"""Generates the messages as another language would, and runs the bare scripts with only these."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from google.protobuf import descriptor_pb2

from scripts.generate_proto import PROTO_ROOT, foxglove_descriptors

HERE = Path(__file__).parent


def generate_messages(out: Path) -> None:
    """Write `helios/v1` and `foxglove` below `out`: protoc's own output, not the project's."""
    ours = sorted(str(p.relative_to(PROTO_ROOT)) for p in PROTO_ROOT.rglob("*.proto"))
    foxglove = foxglove_descriptors()
    theirs = [f.name for f in foxglove.file if f.name.startswith("foxglove/")]
    base, full = out / "foxglove.binpb", out / "all.binpb"
    base.write_bytes(foxglove.SerializeToString())
    protoc = [sys.executable, "-m", "grpc_tools.protoc"]
    subprocess.run(
        [
            *protoc,
            f"--descriptor_set_in={base}",
            f"--proto_path={PROTO_ROOT}",
            f"--descriptor_set_out={full}",
            *ours,
        ],
        check=True,
    )
    merged = descriptor_pb2.FileDescriptorSet.FromString(full.read_bytes())
    merged.MergeFrom(foxglove)
    full.write_bytes(merged.SerializeToString())
    subprocess.run(
        [*protoc, f"--descriptor_set_in={full}", f"--python_out={out}", *ours, *theirs], check=True
    )


@contextmanager
def bare_robot(messages: Path, router: str) -> Iterator[None]:
    """Run the robot until the context ends. Fails if the robot imports anything of HELIOS."""
    process = subprocess.Popen(
        [sys.executable, str(HERE / "robot.py"), router],
        env=os.environ | {"PYTHONPATH": str(messages)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline()) == {"serves": 6, "imports_of_helios": []}
        yield
    finally:
        process.kill()
        process.communicate()


def bare_driver(messages: Path, router: str) -> dict:
    """Run the client to its end; its output."""
    done = subprocess.run(
        [sys.executable, str(HERE / "driver.py"), router],
        env=os.environ | {"PYTHONPATH": str(messages)},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
