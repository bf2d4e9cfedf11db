"""Tests that `make install` compiles every kernel."""

from __future__ import annotations

import importlib
import pkgutil

import pytest
from helios_eval.kernel_compilation import warm_up
from numba.core.registry import CPUDispatcher


def kernels_of(package: str) -> dict[str, CPUDispatcher]:
    """Every kernel of a package by name."""
    found = {}
    for module in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
        if not module.name.endswith("__main__"):
            for name, it in vars(importlib.import_module(module.name)).items():
                if isinstance(it, CPUDispatcher):
                    found[name] = it
    return found


@pytest.mark.parametrize("package", ["helios_map2d", "helios_objectmap", "helios_planner"])
def test_no_kernel_is_left_to_compile_at_its_first_call(package: str) -> None:
    warm_up()
    kernels = kernels_of(package)
    within = {name for k in kernels.values() for name in k.py_func.__code__.co_names}
    assert [n for n, k in kernels.items() if not k.signatures and n not in within] == []
