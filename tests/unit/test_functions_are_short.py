"""Tests the length of functions; numba kernels are exempt, since a call inside them costs time."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MOST_LINES = 60


def _compiled(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any(
        name in ast.dump(decorator)
        for decorator in function.decorator_list
        for name in ("jit", "kernel")
    )


def test_no_function_is_longer_than_sixty_lines() -> None:
    long = []
    for top in ("services", "shared", "clients", "scripts", "tests"):
        for path in sorted((ROOT / top).rglob("*.py")):
            if path.name.endswith("_pb2.py"):
                continue
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                    lines = (node.end_lineno or node.lineno) - node.lineno + 1
                    if lines > MOST_LINES and not _compiled(node):
                        long.append(f"{path.relative_to(ROOT)}: {node.name} has {lines} lines")
    assert not long
