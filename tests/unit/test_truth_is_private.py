"""Tests that only the simulated detector and the evaluation use the simulator's truth."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from helios_core.topics import METHODS, TOPICS

ROOT = Path(__file__).resolve().parents[2]
MAY_READ = (
    "services/helios_detector",
    "clients/helios_sim",
    "clients/helios_eval",
    "clients/helios_chaos",
)
TRUTH_NAMES = {
    "TRUTH_SEGMENTATION",
    "TRUTH_EPISODE",
    "TRUTH_METRICS",
    "TRUTH_OBJECTS",
    "TRUTH_TRACE",
}
FILES = sorted(
    p
    for folder in ("services", "clients")
    for p in (ROOT / folder).rglob("*.py")
    if not str(p.relative_to(ROOT)).startswith(MAY_READ)
)


def test_truth_keys_are_separate_from_all_other_keys() -> None:
    for method in METHODS:
        assert ("/truth/" in method.key("r")) == method.truth
    assert all("/truth/" not in topic.key("r") for topic in TOPICS)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_other_module_names_the_truth(path: Path) -> None:
    tree = ast.parse(path.read_text())
    names = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)}
    names |= {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
    names |= {a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names}
    assert not names & TRUTH_NAMES
    constants = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)]
    assert not any(isinstance(c, str) and "/truth/" in c for c in constants)
