"""Where models run and in which precision when nobody says so."""

from types import SimpleNamespace
from typing import Any

import pytest
from helios_detector.hf.runtime import _device, _dtype


def torch_with(cuda: bool, mps: bool = False, bf16: bool = True) -> Any:
    """What is asked of torch, as if the machine had that."""
    return SimpleNamespace(
        cuda=SimpleNamespace(is_available=lambda: cuda, is_bf16_supported=lambda: bf16),
        backends=SimpleNamespace(mps=SimpleNamespace(is_available=lambda: mps)),
        float32="float32", float16="float16", bfloat16="bfloat16",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("cuda", "mps", "bf16", "device", "precision"),
    [
        (True, False, True, "cuda", "bfloat16"),
        (True, False, False, "cuda", "float16"),
        (False, True, True, "mps", "float32"),
        (False, False, True, "cpu", "float32"),
    ],
)
def test_half_precision_on_cuda_alone(
    cuda: bool, mps: bool, bf16: bool, device: str, precision: str
):
    torch = torch_with(cuda, mps, bf16)
    assert _device("auto", torch) == device
    assert _dtype("auto", device, torch) == precision
    assert _dtype("float16", device, torch) == "float16"
