"""Generate the Python modules of the protobuf messages; `--check` exits 1 if they are stale.

Foxglove's schemas come as descriptors from the installed package, so this repository holds no copy
of their `.proto` files.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import foxglove_schemas_protobuf
from google.protobuf import descriptor_pb2, duration_pb2, timestamp_pb2
from google.protobuf.message import Message

ROOT = Path(__file__).resolve().parent.parent
PROTO_ROOT = ROOT / "shared/helios_core/proto"  # `.proto` files and generated modules


def foxglove_descriptors() -> descriptor_pb2.FileDescriptorSet:
    """Foxglove's schemas and the well-known types that they import."""
    out = descriptor_pb2.FileDescriptorSet()
    files = [timestamp_pb2.DESCRIPTOR, duration_pb2.DESCRIPTOR]
    for info in pkgutil.iter_modules(foxglove_schemas_protobuf.__path__):
        if info.name.endswith("_pb2"):
            module = importlib.import_module(f"foxglove_schemas_protobuf.{info.name}")
            files.append(module.DESCRIPTOR)
    for file in files:
        proto: Message = out.file.add()
        file.CopyToProto(proto)
    return out


def generate(out: Path) -> None:
    """Write `helios/v1/*_pb2.py` and `.pyi` below `out`. They import each other by full package
    name."""
    sources = sorted(str(p.relative_to(PROTO_ROOT)) for p in PROTO_ROOT.rglob("*.proto"))
    with tempfile.TemporaryDirectory() as scratch:
        # Foxglove's files come as descriptors; ours are added to the same set.
        base = Path(scratch) / "foxglove.binpb"
        base.write_bytes(foxglove_descriptors().SerializeToString())
        raw = Path(scratch) / "raw"
        raw.mkdir()
        full = Path(scratch) / "all.binpb"
        subprocess.run(
            [
                sys.executable,
                "-m",
                "grpc_tools.protoc",
                f"--descriptor_set_in={base}",
                f"--proto_path={PROTO_ROOT}",
                f"--descriptor_set_out={full}",
                *sources,
            ],
            check=True,
        )
        merged = descriptor_pb2.FileDescriptorSet.FromString(base.read_bytes())
        merged.MergeFromString(full.read_bytes())
        base.write_bytes(merged.SerializeToString())
        subprocess.run(
            [
                sys.executable,
                "-m",
                "grpc_tools.protoc",
                f"--descriptor_set_in={base}",
                f"--python_out={raw}",
                f"--pyi_out={raw}",
                *sources,
            ],
            check=True,
        )
        for path in sorted(raw.rglob("*_pb2.py*")):
            text = path.read_text()
            text = re.sub(r"from foxglove import", "from foxglove_schemas_protobuf import", text)
            text = re.sub(
                r"from helios\.v1 import", "from helios_core.proto.helios.v1 import", text
            )
            target = out / path.relative_to(raw)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text)


def modules(root: Path) -> dict[str, str]:
    """Generated modules below a folder: relative path -> text."""
    found = (*root.rglob("*_pb2.py"), *root.rglob("*_pb2.pyi"))
    return {str(path.relative_to(root)): path.read_text() for path in found}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 if stale")
    args = parser.parse_args()
    if not args.check:
        generate(PROTO_ROOT)
        return
    with tempfile.TemporaryDirectory() as scratch:
        generate(Path(scratch))
        fresh = modules(Path(scratch))
    kept = modules(PROTO_ROOT)
    if removed := sorted(kept.keys() - fresh.keys()):
        sys.exit(f"no .proto file makes {', '.join(removed)} any more; delete them")
    if stale := sorted(name for name, text in fresh.items() if kept.get(name) != text):
        sys.exit(f"generated messages are stale: {', '.join(stale)}; run scripts/generate_proto.py")


if __name__ == "__main__":
    main()
