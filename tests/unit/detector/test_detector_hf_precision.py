"""Default device and precision of the models, and the number of threads."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import tiny_models
import torch
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_detector.hf.model_runtime import HfModel, Placement, _device, _dtype


def torch_with(cuda: bool, mps: bool = False, bf16: bool = True) -> Any:
    """The parts of torch that are queried, as on a machine with this hardware."""
    return SimpleNamespace(
        __version__="2",
        cuda=SimpleNamespace(
            is_available=lambda: cuda, is_bf16_supported=lambda: bf16, device_count=lambda: 2
        ),
        backends=SimpleNamespace(mps=SimpleNamespace(is_available=lambda: mps)),
        float32="float32",
        float16="float16",
        bfloat16="bfloat16",
    )


@pytest.mark.parametrize(
    ("cuda", "mps", "bf16", "device", "precision"),
    [
        (True, False, True, "cuda", "bfloat16"),
        (True, False, False, "cuda", "float16"),
        (False, True, True, "mps", "float32"),
        (False, False, True, "cpu", "float32"),
    ],
)
def test_half_precision_is_the_default_on_cuda_only(
    cuda: bool, mps: bool, bf16: bool, device: str, precision: str
):
    machine = torch_with(cuda, mps, bf16)
    assert _device("auto", machine) == device
    assert _dtype("auto", device, machine) == precision
    assert _dtype("float16", device, machine) == "float16"


@pytest.mark.parametrize(
    ("device", "kind", "says"),
    [
        ("cuda:9", Unavailable, "device is 'cuda:9' and torch 2 finds 2 CUDA devices here; set"),
        ("cuda:x", InvalidInput, "device is 'cuda:x'; set auto, cpu, cuda, cuda:N or mps"),
        ("cuda:", InvalidInput, "device is 'cuda:'; set auto"),
        ("cuda:-1", InvalidInput, "device is 'cuda:-1'; set auto"),
    ],
)
def test_a_device_number_that_is_not_there_is_refused_by_the_setting(
    device: str, kind: type[HeliosError], says: str
):
    with pytest.raises(kind, match=says):
        _device(device, torch_with(cuda=True))
    assert _device("cuda:1", torch_with(cuda=True)) == "cuda:1"


def test_a_model_on_the_cpu_uses_the_set_number_of_threads(tmp_path: Path):
    before = torch.get_num_threads()
    folder = tiny_models.write("clip", tmp_path)
    try:
        for threads in (1, 2):
            with HfModel(
                str(folder), "scorer", Placement("cpu", threads=threads), "AutoModel"
            ).use():
                assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)


def test_weights_are_loaded_in_half_precision_unless_the_model_opts_out(tmp_path: Path):
    folder, half = str(tiny_models.write("clip", tmp_path)), Placement("cpu", "bfloat16")
    for halved, dtype in ((True, torch.bfloat16), (False, torch.float32)):
        handle = HfModel(folder, "scorer", half, "AutoModel", half_weights=halved)
        with handle.use() as (model, _):
            assert next(model.parameters()).dtype == dtype
