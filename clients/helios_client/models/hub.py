"""Models of the Hugging Face hub, by its own library: it honours HF_ENDPOINT and HF_TOKEN."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from helios_core.errors import HeliosError, InvalidInput, Unavailable

from helios_client.models.checksums import Published

SMALL = ("*.json", "*.txt", "*.model", "*.jinja", "*.md", "LICENSE*", "NOTICE*")
WEIGHTS = (  # of the first format that the model has
    ("model.safetensors", "model-*.safetensors"),
    ("pytorch_model.bin", "pytorch_model-*.bin"),
)


@dataclass(frozen=True)
class HubModel:
    """A model as the hub describes it."""

    id: str
    source: str
    revision: str  # commit
    licence: str
    files: tuple[Published, ...]  # those that `transformers` needs

    @property
    def bytes(self) -> int:
        return sum(f.bytes or 0 for f in self.files)


def describe(id: str, revision: str | None) -> HubModel:
    """Ask the hub. Raises Unavailable (hub, licence), or InvalidInput (no such model, no
    weights)."""
    library = _library()
    try:
        info = library.HfApi().model_info(id, revision=revision, files_metadata=True)
    except Exception as error:
        raise hub_fault(error, id) from error
    files = {s.rfilename: _published(s) for s in info.siblings or ()}
    names = needed(files)
    card = info.card_data.to_dict() if info.card_data else {}
    licence = str(card.get("license_name") or card.get("license") or "not stated")
    source = f"{library.constants.ENDPOINT}/{id}"
    return HubModel(id, source, info.sha or "", licence, tuple(files[n] for n in names))


def needed(names: Iterable[str]) -> list[str]:
    """Names of the files that `transformers` loads: top-level texts, and one format of weights.

    Raises InvalidInput without weights.
    """
    top = sorted(name for name in names if "/" not in name)
    weights = next((found for kind in WEIGHTS if (found := _matching(top, kind))), None)
    if weights is None:
        raise InvalidInput(
            "the model has no weights of transformers (model.safetensors or pytorch_model.bin); "
            "name a model of a kind that docs/how-to/models.md lists"
        )
    return sorted({*weights, *_matching(top, SMALL)})


def fetch_file(model: HubModel, name: str, to: Path) -> Path:
    """Download one file into the folder `to`; an earlier attempt continues. Raises Unavailable."""
    library = _library()
    try:
        return Path(library.hf_hub_download(model.id, name, revision=model.revision, local_dir=to))
    except Exception as error:
        raise hub_fault(error, model.id) from error


def show_progress(shown: bool) -> None:
    """Show or hide the library's progress bars."""
    from huggingface_hub import utils

    (utils.enable_progress_bars if shown else utils.disable_progress_bars)()


def hub_fault(error: Exception, id: str) -> HeliosError:
    """The typed error for an exception of the library."""
    from huggingface_hub import errors

    endpoint = _library().constants.ENDPOINT
    if isinstance(error, errors.GatedRepoError):
        return Unavailable(
            f"the licence of {id} must be accepted first: log in at {endpoint}/{id}, accept it, "
            "and set HF_TOKEN on this machine"
        )
    if isinstance(error, errors.RevisionNotFoundError):
        return InvalidInput(f"{id} has no such revision; correct --revision")
    if isinstance(error, errors.RepositoryNotFoundError | errors.HFValidationError):
        return InvalidInput(
            f"{endpoint} has no model {id!r} that this machine may read; correct the name, or set "
            "HF_TOKEN if it is private"
        )
    if isinstance(error, errors.OfflineModeIsEnabled):
        return Unavailable("HF_HUB_OFFLINE forbids downloads; unset it to fetch models")
    lost = isinstance(error, httpx.HTTPError | errors.LocalEntryNotFoundError)  # the connection
    if isinstance(error, OSError) and not lost:
        return Unavailable(f"{id} cannot be stored: {error.strerror or error}")
    return Unavailable(
        f"{id} cannot be fetched from {endpoint} ({type(error).__name__}: {_first_line(error)}); "
        "run the command again, it continues; HF_ENDPOINT names a mirror"
    )


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), "")[:200]


def _matching(names: list[str], patterns: tuple[str, ...]) -> list[str]:
    return [n for n in names if any(fnmatch.fnmatchcase(n, p) for p in patterns)]


def _published(sibling: Any) -> Published:
    sha256 = sibling.lfs.sha256 if sibling.lfs else None
    return Published(sibling.rfilename, sibling.size, sha256, None if sha256 else sibling.blob_id)


def _library() -> Any:
    try:
        import huggingface_hub
    except ImportError as error:
        raise Unavailable(
            "models of the hub need huggingface-hub; pip install 'helios-ovmm[models]'"
        ) from error
    return huggingface_hub
