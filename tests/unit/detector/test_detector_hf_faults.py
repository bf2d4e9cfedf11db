"""Each fault of a model becomes one typed error with one sentence that says what to do."""

import errno
import json
from pathlib import Path
from typing import Any

import pytest
import tiny_models
from helios_core.errors import Internal, InvalidInput, Unavailable
from helios_core.models.model_folder import LockedFile, LockedModel, write_lock
from helios_detector.backend import DetectorOptions
from helios_detector.hf import model_runtime
from helios_detector.hf.model_errors import load_fault, run_fault
from helios_detector.hf.model_runtime import HfModel, Placement, need_library, source_of
from helios_detector.memory_usage import weights_mb
from helios_detector.model_loading import open_detector, open_scorer
from huggingface_hub import errors as hub
from safetensors.torch import load_file, save_file


def wrapped(cause: Exception) -> OSError:
    """The error as transformers raises it."""
    error = OSError("You are trying to access something.\nMake sure …")
    error.__cause__ = cause
    return error


CAUSES = {
    "not here": (
        wrapped(hub.LocalEntryNotFoundError("cannot find")),
        "a/b is not on this machine; run `helios models fetch a/b`",
    ),
    "offline": (hub.OfflineModeIsEnabled("offline"), "a/b is not on this machine"),
    "memory": (MemoryError(), "too little memory for a/b.*smaller model"),
    "cuda": (
        RuntimeError("CUDA out of memory. Tried to allocate 2 GiB"),
        "too little memory for a/b",
    ),
    "cpu": (
        RuntimeError(
            "[enforce fail] DefaultCPUAllocator: not enough memory: you tried to allocate"
        ),
        "too little memory for a/b",
    ),
    "disk": (OSError(errno.ENOSPC, "No space left on device"), "the disk is full.*HF_HOME"),
    "package": (
        ImportError("Timm requires the timm library but it was not found"),
        r"a/b needs a package that is missing \(ImportError: Timm requires",
    ),
    "permission": (PermissionError(errno.EACCES, "denied"), "allow this user to read it"),
}


@pytest.mark.parametrize("name", CAUSES)
def test_each_load_fault_has_its_own_sentence(name: str):
    error, sentence = CAUSES[name]
    fault = load_fault(error, "a/b", "detector")
    assert isinstance(fault, Unavailable)
    assert "\n" not in fault.message
    with pytest.raises(Unavailable, match=sentence):
        raise fault


def test_a_fault_at_a_frame_is_internal_unless_memory_ran_out():
    assert isinstance(run_fault(ValueError("shape"), "a/b", "detector"), Internal)
    assert isinstance(run_fault(MemoryError(), "a/b", "detector"), Unavailable)


def test_a_missing_model_folder_is_reported(tmp_path: Path):
    with pytest.raises(Unavailable, match=r"the model folder .*missing is not there; put config"):
        open_detector(f"transformers:{tmp_path / 'missing'}", DetectorOptions())


def test_a_model_that_is_not_here_is_named_with_its_size_and_never_downloaded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """No call reaches the network: every connection would fail the test."""

    def refuse(*_: object) -> None:
        raise AssertionError("the detector tried to connect")

    monkeypatch.setenv("HELIOS_MODELS", str(tmp_path))
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("socket.socket.connect", refuse)
    sentence = r"google/owlv2-base-patch16-ensemble \(about 616 MB, Apache-2.0\) is not on this"
    with pytest.raises(Unavailable, match=sentence):
        open_detector("transformers:google/owlv2-base-patch16-ensemble", DetectorOptions())


def test_a_fetched_model_is_opened_by_its_id(
    owl: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    place = tmp_path / "someone" / "fetched-owl"
    place.mkdir(parents=True)
    copy_of(owl, place)
    files = {f.name: LockedFile(f.stat().st_size, "", "publisher") for f in place.iterdir()}
    lock = {"someone/fetched-owl": LockedModel("", "c0ffee", "mit", "", files)}
    write_lock(tmp_path, lock)
    monkeypatch.setenv("HELIOS_MODELS", str(tmp_path))
    open_detector("transformers:someone/fetched-owl", DetectorOptions(device="cpu")).warm_up()


def test_a_folder_without_a_model_is_reported_as_incomplete(tmp_path: Path):
    with pytest.raises(Unavailable, match="is not complete"):
        open_detector(f"transformers:{tmp_path}", DetectorOptions())


@pytest.fixture(scope="module")
def owl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_models.write("owlv2", tmp_path_factory.mktemp("owl"))


def opened(folder: Path) -> HfModel:
    return HfModel(str(folder), "detector", Placement("cpu"), "AutoModelForZeroShotObjectDetection")


def copy_of(folder: Path, to: Path, without: str = "") -> Path:
    for file in folder.iterdir():
        if file.name != without:
            (to / file.name).write_bytes(file.read_bytes())
    return to


def test_a_damaged_weight_file_is_reported(owl: Path, tmp_path: Path):
    broken = copy_of(owl, tmp_path)
    (broken / "model.safetensors").write_bytes(b"\x00" * 100)
    with pytest.raises(Unavailable, match=r"a weight file of .* is damaged"), opened(broken).use():
        pass


def test_missing_weights_are_reported(owl: Path, tmp_path: Path):
    with (
        pytest.raises(Unavailable, match=r"is not complete .*copy all of its files"),
        opened(copy_of(owl, tmp_path, "model.safetensors")).use(),
    ):
        pass


def test_a_missing_tokenizer_is_reported(owl: Path, tmp_path: Path):
    with (
        pytest.raises(Unavailable, match="is not complete: its tokenizer knows"),
        opened(copy_of(owl, tmp_path, "tokenizer.json")).use(),
    ):
        pass


def edited(folder: Path, to: Path, **config: Any) -> Path:
    """A copy with changed entries in its configuration."""
    out = copy_of(folder, to)
    reported = json.loads((out / "config.json").read_text())
    (out / "config.json").write_text(json.dumps(reported | config))
    return out


def test_a_truncated_weight_file_is_reported_as_damaged(owl: Path, tmp_path: Path):
    broken = copy_of(owl, tmp_path)
    whole = (broken / "model.safetensors").read_bytes()
    (broken / "model.safetensors").write_bytes(whole[:-5000])
    with pytest.raises(Unavailable, match=r"a weight file of .* is damaged"), opened(broken).use():
        pass


@pytest.mark.parametrize("name", ["model.safetensors", "pytorch_model.bin"])
def test_a_weight_file_that_is_a_dangling_link_is_reported_as_incomplete(
    owl: Path, tmp_path: Path, name: str
):
    folder = copy_of(owl, tmp_path, "model.safetensors")
    (folder / name).symlink_to(tmp_path / "gone")
    assert weights_mb(str(folder)) == 0
    with (
        pytest.raises(Unavailable, match=r"is not complete .*copy all of its files"),
        opened(folder).use(),
    ):
        pass


@pytest.mark.parametrize("missing", ["config.json", "processor_config.json"])
def test_a_folder_that_lacks_a_file_is_reported_as_incomplete(
    owl: Path, tmp_path: Path, missing: str
):
    folder = copy_of(owl, tmp_path, missing)
    with pytest.raises(Unavailable, match=r"is not complete .*copy all of its files"):
        open_detector(f"transformers:{folder}", DetectorOptions(device="cpu")).warm_up()


def test_a_truncated_configuration_is_reported_as_damaged(owl: Path, tmp_path: Path):
    folder = copy_of(owl, tmp_path)
    (folder / "config.json").write_text('{"model_type": "owlv2"')
    with pytest.raises(Unavailable, match=r"a file of .* is damaged .*copy it again"):
        open_detector(f"transformers:{folder}", DetectorOptions())


def test_weights_that_do_not_fit_the_configuration_are_refused(owl: Path, tmp_path: Path):
    reported = json.loads((owl / "config.json").read_text())
    vision = reported["vision_config"] | {"intermediate_size": 64}
    folder = edited(owl, tmp_path, vision_config=vision)
    with pytest.raises(InvalidInput, match="do not belong together"), opened(folder).use():
        pass


def test_a_model_whose_weights_lack_the_scoring_heads_is_refused(tmp_path: Path):
    """A captioning BLIP-2 has the model type of a scoring one, but no scoring heads; these would
    have random weights.
    """
    folder = tiny_models.write("blip-2", tmp_path / "blip")
    weights = load_file(folder / "model.safetensors")
    without = {k: v for k, v in weights.items() if "itm_head" not in k and "_projection" not in k}
    assert len(without) == len(weights) - 6
    save_file(without, folder / "model.safetensors", {"format": "pt"})
    scorer = open_scorer(f"transformers:{folder}", DetectorOptions(device="cpu"))
    with pytest.raises(InvalidInput, match=r"lack 6 of the weights .*\(itm_head.bias, .*random"):
        scorer.warm_up()


def test_code_that_comes_with_a_model_is_never_run(owl: Path, tmp_path: Path):
    folder = edited(owl, tmp_path, model_type="own", auto_map={"AutoConfig": "own.Config"})
    mark = tmp_path / "ran"
    (folder / "own.py").write_text(f"open({str(mark)!r}, 'w')\nclass Config: pass\n")
    with pytest.raises(InvalidInput, match="needs code of its own, which is never run here"):
        open_detector(f"transformers:{folder}", DetectorOptions())
    assert not mark.exists()


def test_the_weight_size_is_computed_for_the_precision_that_is_loaded(owl: Path, tmp_path: Path):
    """Files may hold float32 and be loaded in half precision, or the other way round."""
    exact = weights_mb(str(owl))
    assert weights_mb(str(owl), 2) == pytest.approx(exact / 2, rel=0.01)
    numbers = load_file(owl / "model.safetensors")
    save_file({k: v.half() for k, v in numbers.items()}, tmp_path / "model.safetensors")
    assert weights_mb(str(tmp_path)) == pytest.approx(exact, rel=0.01)
    (tmp_path / "model.safetensors").write_bytes(b"\xff" * 1000)
    assert weights_mb(str(tmp_path)) == 0.001


def test_weights_that_cannot_fit_are_refused_before_they_are_read(
    owl: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(model_runtime, "free_mb", lambda device: 0.001)
    with (
        pytest.raises(Unavailable, match=r"MB of weights and cpu has 0 MB free; stop what else"),
        opened(owl).use(),
    ):
        pass


def test_running_out_of_memory_at_a_frame_unloads_the_model(owl: Path):
    model = opened(owl)
    with pytest.raises(Unavailable, match="too little memory"), model.use():
        raise MemoryError
    assert not model.loaded


def test_a_missing_library_is_reported_with_the_extra_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name, package=None: None if name == "torch" else name
    )
    with pytest.raises(Unavailable, match=r"needs torch, not installed here; pip install 'helios-"):
        need_library()


@pytest.mark.parametrize("spec", ["transformers:", "owlv2", "onnx:x"])
def test_a_malformed_model_spec_is_refused(spec: str):
    with pytest.raises(InvalidInput, match="set transformers:<model id or folder>"):
        source_of(spec, "detector")


@pytest.fixture
def cache(owl: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A hub cache that holds one model, on a machine without a network."""
    snapshot = tmp_path / "models--someone--owl" / "snapshots" / ("0" * 40)
    snapshot.mkdir(parents=True)
    copy_of(owl, snapshot)
    refs = tmp_path / "models--someone--owl" / "refs"
    refs.mkdir()
    (refs / "main").write_text("0" * 40)
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    return tmp_path


def test_a_cached_model_id_works_without_a_network(cache: Path):
    detector = open_detector("transformers:someone/owl", DetectorOptions(device="cpu"))
    detector.warm_up()
    with pytest.raises(Unavailable, match="someone/other is not on this machine"):
        open_detector("transformers:someone/other", DetectorOptions())


def test_the_weight_size_of_a_cached_model_id_is_checked_too(
    cache: Path, monkeypatch: pytest.MonkeyPatch
):
    assert weights_mb("someone/owl") > 0.01
    assert weights_mb("someone/other") == 0
    monkeypatch.setattr(model_runtime, "free_mb", lambda device: 0.001)
    with pytest.raises(Unavailable, match="someone/owl has 0 MB of weights and cpu has 0 MB free"):
        open_detector("transformers:someone/owl", DetectorOptions(device="cpu")).warm_up()
