"""One model and its processor: device, precision, loading and unloading."""

from __future__ import annotations

import contextlib
import importlib.util
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput, Unavailable
from helios_core.models.model_folder import fetched
from helios_core.printable_text import counted
from numpy.typing import NDArray

from helios_detector.hf.model_errors import EXTRA, check_whole, load_fault, out_of_memory, run_fault
from helios_detector.memory_usage import accelerator_mb, free_mb, weights_mb

PRECISIONS = ("auto", "float32", "float16", "bfloat16")
SCHEME = "transformers:"
SMALLEST_VOCABULARY = 64  # the library makes an empty tokenizer if its files are missing


@dataclass(frozen=True)
class Placement:
    """Device, precision and CPU threads of a model."""

    device: str = "auto"  # auto: cuda, else mps, else cpu
    precision: str = "auto"  # auto: half on cuda, float32 elsewhere
    threads: int = 1  # on the CPU


def source_of(spec: str, setting: str) -> str:
    """The folder, or a model id of the hub's cache, in `transformers:<model id or folder>`.

    A fetched model (`helios models fetch`) is a folder, too. Nothing is ever downloaded. Raises
    InvalidInput for another form, Unavailable for a missing folder.
    """
    source = spec.removeprefix(SCHEME).strip()
    if not spec.startswith(SCHEME) or not source:
        raise InvalidInput(f"{setting} is {spec!r}; set {SCHEME}<model id or folder>")
    path = Path(source).expanduser()
    if path.exists():
        return str(path)
    if source.startswith(("/", ".", "~")) or source.count("/") > 1:
        raise Unavailable(
            f"the model folder {path} is not there; put config.json, the weights and the "
            f"processor's files there, or correct {setting}"
        )
    place = fetched(source) if source.count("/") == 1 else None
    return str(place) if place else source


def need_library() -> Any:
    """The `transformers` module. Raises Unavailable when it is not installed."""
    missing = [n for n in ("torch", "transformers", "PIL") if importlib.util.find_spec(n) is None]
    if missing:
        raise Unavailable(f"{SCHEME}… needs {', '.join(missing)}, not installed here; {EXTRA}")
    tolerate_torchvision()
    import transformers

    transformers.utils.logging.disable_progress_bar()
    return transformers


def tolerate_torchvision() -> None:
    """Make torchvision importable if its compiled part was built for another torch.

    Image processors use only its Python part, but the import fails for missing operators (a CPU
    torch with the index's torchvision). This declares them without a kernel; a call still raises.
    """
    spec = importlib.util.find_spec("torchvision")
    if spec is None or not spec.submodule_search_locations:
        return
    import torch

    for library in Path(spec.submodule_search_locations[0]).glob("_C*.so"):
        try:
            torch.ops.load_library(str(library))
        except OSError:
            for name in ("nms", "qnms"):
                with contextlib.suppress(RuntimeError):  # declared already
                    torch.library.define(
                        f"torchvision::{name}",
                        "(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
                    )


def config_of(source: str, setting: str) -> Any:
    """The model's configuration. Raises the typed errors of `model_errors.load_fault`."""
    transformers = need_library()
    try:
        return transformers.AutoConfig.from_pretrained(
            source, trust_remote_code=False, local_files_only=True
        )
    except Exception as error:
        raise load_fault(error, source, setting) from error


def picture(color: NDArray) -> Any:
    """RGB [h, w, 3] as a PIL image, which every processor takes."""
    from PIL import Image

    return Image.fromarray(color)


class HfModel:
    """A model of one auto class, loaded at the first use and after `unload`. Thread-safe."""

    def __init__(
        self,
        source: str,
        setting: str,  # setting that names the model, for messages
        placement: Placement,
        model_class: str,
        processor_class: str = "AutoProcessor",
        *,
        half_weights: bool = True,  # False: weights stay float32, only the arithmetic is half
    ) -> None:
        if placement.precision not in PRECISIONS:
            raise InvalidInput(
                f"precision is {placement.precision!r}; set one of {', '.join(PRECISIONS)}"
            )
        self.source, self._setting, self._placement = source, setting, placement
        self._model_class, self._processor_class = model_class, processor_class
        self._half_weights = half_weights
        self._lock = threading.Lock()
        self._loaded: tuple[Any, Any] | None = None
        self.device = ""  # set by loading
        self._dtype: Any = None

    @property
    def loaded(self) -> bool:
        return self._loaded is not None

    @contextlib.contextmanager
    def use(self) -> Iterator[tuple[Any, Any]]:
        """(model, processor) for one thread at a time, without gradients, in the set precision.

        Raises Unavailable (cannot be loaded, too little memory), InvalidInput (wrong model) or
        Internal (it fails).
        """
        with self._lock:
            model, processor = self._loaded or self._load()
            import torch

            half = self._dtype != torch.float32
            try:
                with (
                    torch.inference_mode(),
                    torch.autocast(self.device.partition(":")[0], self._dtype, enabled=half),
                ):
                    yield model, processor
            except Exception as error:
                if out_of_memory(error):
                    del model, processor
                    self._free()
                raise run_fault(error, self.source, self._setting) from error

    def to_device(self, inputs: Any) -> dict[str, Any]:
        """A processor's output, moved to the model's device."""
        return {k: v.to(self.device) if hasattr(v, "to") else v for k, v in inputs.items()}

    def unload(self) -> None:
        """Free the memory; the next use loads the model again."""
        with self._lock:
            self._free()

    def accelerator_mb(self) -> float:
        """Peak of the accelerator's memory (MB) since the last call; 0 without an accelerator."""
        return (accelerator_mb(self.device) or 0.0) if self.loaded else 0.0

    def _free(self) -> None:
        if self._loaded is None:
            return
        self._loaded = None
        import gc

        import torch

        gc.collect()
        if torch.cuda.is_available():
            torch.cuda.empty_cache()

    def _load(self) -> tuple[Any, Any]:
        transformers = need_library()
        import torch

        self.device = _device(self._placement.device, torch)
        self._dtype = _dtype(self._placement.precision, self.device, torch)
        if self.device == "cpu":
            torch.set_num_threads(self._placement.threads)
        try:
            self._check_room(self._weights_dtype(torch).itemsize)
            processor = getattr(transformers, self._processor_class).from_pretrained(
                self.source, local_files_only=True
            )
            model, loading_info = getattr(transformers, self._model_class).from_pretrained(
                self.source,
                dtype=self._weights_dtype(torch),
                output_loading_info=True,
                local_files_only=True,
            )
            check_whole(loading_info, self.source, self._setting)
            model = model.eval().to(self.device)
        except Exception as error:
            raise load_fault(error, self.source, self._setting) from error
        tokenizer = getattr(processor, "tokenizer", None)
        if tokenizer is not None and len(tokenizer) < SMALLEST_VOCABULARY:
            raise Unavailable(
                f"{self.source} is not complete: its tokenizer knows {len(tokenizer)} words; copy "
                "all of its files (tokenizer.json or vocab files)"
            )
        self._loaded = model, processor
        return self._loaded

    def _weights_dtype(self, torch: Any) -> Any:
        return self._dtype if self._half_weights else torch.float32

    def _check_room(self, number_bytes: int) -> None:
        free, wanted = free_mb(self.device), weights_mb(self.source, number_bytes)
        if free is not None and wanted > free:
            raise Unavailable(
                f"{self.source} has {wanted:.0f} MB of weights and {self.device} has {free:.0f} MB "
                f"free; stop what else uses it, or use a smaller model ({self._setting})"
            )


def _device(wanted: str, torch: Any) -> str:
    if wanted == "auto":
        if torch.cuda.is_available():
            return "cuda"
        return "mps" if torch.backends.mps.is_available() else "cpu"
    kind, colon, number = wanted.partition(":")
    have = {
        "cpu": True,
        "cuda": torch.cuda.is_available(),
        "mps": torch.backends.mps.is_available(),
    }
    numbered = kind == "cuda" and bool(colon)
    if kind not in have or (numbered and not (number.isascii() and number.isdecimal())):
        raise InvalidInput(f"device is {wanted!r}; set auto, cpu, cuda, cuda:N or mps")
    if not have[kind]:
        raise Unavailable(
            f"device is {wanted!r} and torch {torch.__version__} finds none here; install a driver "
            "and a torch built for it, or set device to cpu"
        )
    if numbered and int(number) >= (count := torch.cuda.device_count()):
        raise Unavailable(
            f"device is {wanted!r} and torch {torch.__version__} finds "
            f"{counted(count, 'CUDA device')} here; set device to cuda:N with N below {count}"
        )
    return wanted


def _dtype(precision: str, device: str, torch: Any) -> Any:
    if precision == "auto":
        if not device.startswith("cuda"):
            return torch.float32
        return torch.bfloat16 if torch.cuda.is_bf16_supported() else torch.float16
    return getattr(torch, precision)
