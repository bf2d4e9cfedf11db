"""Typed errors for failures of loading or running a model, each with one sentence.

`huggingface_hub` and `transformers` raise many types, often wrapped in OSError. These functions
search the exception chain for the cause. They compare types by name, so no library is imported.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator, Mapping
from typing import Any

from helios_core.errors import HeliosError, Internal, InvalidInput, Unavailable
from helios_core.models.catalogue import missing_sentence

NOT_LEARNT = ("position_ids",)  # key endings of buffers that the library fills itself
INCOMPLETE = (  # the library's messages for missing files
    "no file named",
    "does not appear to have",
    "Should have a `model_type`",
    "Can't load image processor",
    "Can't load processor",
    "Can't load tokenizer",
)
EXTRA = "pip install 'helios-ovmm[transformers]'"


def chain(error: BaseException) -> Iterator[BaseException]:
    """The error and all its causes and contexts, each once."""
    seen: set[int] = set()
    todo: list[BaseException | None] = [error]
    while todo:
        e = todo.pop()
        if e is None or id(e) in seen:
            continue
        seen.add(id(e))
        yield e
        todo += [e.__context__, e.__cause__]


def _types(error: BaseException) -> set[str]:
    return {c.__name__ for e in chain(error) for c in type(e).__mro__}


def short(error: BaseException) -> str:
    """The error's type and first line."""
    text = next((line for line in str(error).splitlines() if line.strip()), "")
    return f"{type(error).__name__}: {text.strip()[:200]}"


def out_of_memory(error: BaseException) -> bool:
    """True if the host's or the accelerator's memory ran out."""
    texts = " ".join(str(e).lower() for e in chain(error))
    return (
        bool({"MemoryError", "OutOfMemoryError"} & _types(error))
        or "not enough memory" in texts
        or "cuda out of memory" in texts
    )


def load_fault(error: BaseException, source: str, setting: str) -> HeliosError:
    """The typed error for a model that cannot be loaded. `setting` is the setting to change."""
    if isinstance(error, HeliosError):
        return error
    types, texts = _types(error), " ".join(str(e) for e in chain(error))
    offline = {"LocalEntryNotFoundError", "OfflineModeIsEnabled", "NetworkError", "ConnectError",
               "ConnectTimeout", "ReadTimeout", "ProxyError", "ConnectionError"}  # fmt: skip
    absent = ("couldn't connect to", "not a valid model identifier", "couldn't find them in the")
    if offline & types or any(words in texts.lower() for words in absent):
        return Unavailable(missing_sentence(source))
    if out_of_memory(error):
        return memory_fault(source, setting)
    if any(isinstance(e, OSError) and e.errno == errno.ENOSPC for e in chain(error)):
        return Unavailable(
            f"the disk is full while {source} is stored; free space, or set HF_HOME to another disk"
        )
    if any(isinstance(e, PermissionError) for e in chain(error)):
        return Unavailable(f"{short(error)} while {source} is loaded; allow this user to read it")
    if {"ImportError", "ModuleNotFoundError"} & types:
        return Unavailable(f"{source} needs a package that is missing ({short(error)}); {EXTRA}")
    if "SafetensorError" in types or "UnpicklingError" in types:
        return Unavailable(
            f"a weight file of {source} is damaged ({short(error)}); delete it and let it load "
            "again"
        )
    if any(words in texts for words in INCOMPLETE):
        return Unavailable(f"{source} is not complete ({short(error)}); copy all of its files")
    if "is not a valid JSON file" in texts:
        return Unavailable(f"a file of {source} is damaged ({short(error)}); copy it again")
    if "ignore_mismatched_sizes" in texts:
        return InvalidInput(
            f"config.json and the weights of {source} do not belong together: their sizes differ; "
            "copy all of its files from one model"
        )
    if "contains custom code" in texts:
        return InvalidInput(
            f"{source} needs code of its own, which is never run here; set {setting} to a model of "
            "a kind that docs/how-to/models.md lists"
        )
    return InvalidInput(
        f"{source} cannot be loaded ({short(error)}); set {setting} to a model of a kind that "
        "docs/how-to/models.md lists"
    )


def check_whole(loading_info: Mapping[str, Any], source: str, setting: str) -> None:
    """Check that the model's files contain all weights; the library fills missing ones randomly.

    Such a model, trained for another task or mixed from different files, would give random results.
    Raises InvalidInput.
    """
    missing = {*loading_info["missing_keys"], *(key for key, *_ in loading_info["mismatched_keys"])}
    needed = sorted(key for key in missing if not key.endswith(NOT_LEARNT))
    if needed:
        raise InvalidInput(
            f"the files of {source} lack {len(needed)} of the weights that this use needs "
            f"({', '.join(needed[:2])}, …), which would be random; set {setting} to a model that "
            "was trained for it (docs/how-to/models.md)"
        )


def memory_fault(source: str, setting: str) -> Unavailable:
    return Unavailable(
        f"there is too little memory for {source}; stop what else uses it, use a smaller model "
        f"({setting}), or set precision to float16"
    )


def run_fault(error: BaseException, source: str, setting: str) -> HeliosError:
    """The typed error for a model that fails on a frame."""
    if isinstance(error, HeliosError):
        return error
    if out_of_memory(error):
        return memory_fault(source, setting)
    return Internal(f"{source} failed ({short(error)}); see the detector's log")
