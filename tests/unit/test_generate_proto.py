"""Tests that `generate_proto.py --check` finds stale, missing and obsolete modules."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from scripts import generate_proto


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the project's messages and their up-to-date modules."""
    root = shutil.copytree(
        generate_proto.PROTO_ROOT,
        tmp_path / "proto",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    monkeypatch.setattr(generate_proto, "PROTO_ROOT", root)
    monkeypatch.setattr(sys, "argv", ["generate_proto.py", "--check"])
    return root


def test_modules_of_removed_messages_are_named(root: Path) -> None:
    generate_proto.main()
    (root / "helios/v1/forgotten_pb2.py").write_text("")
    with pytest.raises(SystemExit, match=r"forgotten_pb2\.py any more; delete"):
        generate_proto.main()


def test_missing_and_changed_modules_are_named(root: Path) -> None:
    first, second = sorted(root.rglob("*_pb2.py"))[:2]
    first.unlink()
    second.write_text(second.read_text() + "\n")
    with pytest.raises(SystemExit, match=f"stale: .*{first.name}, .*{second.name}; run"):
        generate_proto.main()
