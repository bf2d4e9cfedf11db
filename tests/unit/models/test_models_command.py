"""`helios models` as a process against a local hub: fetch, continue, verify, list, refuse."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest
from helios_core.models.catalogue import CATALOGUE
from helios_core.models.model_folder import LOCK, fetched

from tests.unit.models.local_hub import COMMIT, ID, LocalHub, sha256

pytest.importorskip("huggingface_hub", reason="pip install 'helios-ovmm[models]'")

WEIGHTS = random.Random(1).randbytes(3_000_000)
FILES = {
    "config.json": b'{"model_type": "owlv2"}',
    "README.md": b"an owl",
    "model.safetensors": WEIGHTS,
    "pytorch_model.bin": b"the same in another format",
    "onnx/model.onnx": b"not needed",
}
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def hub() -> Iterator[LocalHub]:
    with closing(LocalHub(dict(FILES), frozenset({"model.safetensors"}), WEIGHTS[:9000])) as hub:
        yield hub


@pytest.fixture
def models(hub: LocalHub, tmp_path: Path) -> Run:
    """Run `helios models` on an empty home, with the local hub as both mirrors."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("HF_", "HELIOS_"))}
    env |= {
        "HOME": str(tmp_path),
        "HF_ENDPOINT": hub.url,
        "HELIOS_MODELS_MIRROR": hub.url,
        "HELIOS_MODELS": str(tmp_path / "models"),
        "XDG_DATA_HOME": "",
        "XDG_CACHE_HOME": "",
    }

    def run(*args: str, **more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "helios_client", *args],
            env=env | more,
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )

    return run


def test_a_fetched_model_is_complete_locked_and_verified(
    hub: LocalHub, models: Run, tmp_path: Path
) -> None:
    done = models("models", "fetch", ID)
    assert done.returncode == 0, done.stderr
    assert "3 MB, licence apache-2.0" in done.stdout  # before the download
    place = tmp_path / "models" / "someone" / "owl"
    found = {f.name for f in place.iterdir() if f.is_file()}
    assert found == {"config.json", "README.md", "model.safetensors"}  # one format of weights
    lock = json.loads((tmp_path / "models" / LOCK).read_text())["models"][ID]
    assert lock["revision"] == COMMIT
    assert lock["licence"] == "apache-2.0"
    weights = lock["files"]["model.safetensors"]
    assert weights == {"bytes": len(WEIGHTS), "sha256": sha256(WEIGHTS), "checked_by": "publisher"}
    assert models("models", "verify").returncode == 0
    before = len(hub.gets)
    again = models("models", "fetch", ID)
    assert "already there" in again.stdout
    assert len(hub.gets) == before


def test_a_changed_file_is_found_and_fetched_again(models: Run, tmp_path: Path) -> None:
    assert models("models", "fetch", ID).returncode == 0
    weights = tmp_path / "models" / "someone" / "owl" / "model.safetensors"
    weights.write_bytes(b"\0" + WEIGHTS[1:])
    done = models("models", "verify", ID)
    assert done.returncode == 1
    assert "model.safetensors has another SHA-256" in done.stderr
    weights.unlink()
    assert "model.safetensors is missing" in models("models", "verify").stderr
    assert models("models", "fetch", ID).returncode == 0
    assert models("models", "verify").returncode == 0


def test_content_that_differs_from_the_published_checksum_is_refused(
    hub: LocalHub, models: Run, tmp_path: Path
) -> None:
    info = hub.info()
    for entry in info["siblings"]:
        if entry["rfilename"] == "model.safetensors":
            entry["lfs"]["sha256"] = sha256(b"something else")
    hub.info = lambda: info  # type: ignore[method-assign]
    done = models("models", "fetch", ID)
    assert done.returncode == 1
    assert "model.safetensors of someone/owl is damaged: its SHA-256 is" in done.stderr
    assert not (tmp_path / "models" / "someone" / "owl" / "model.safetensors").exists()
    assert fetched(ID, tmp_path / "models") is None


def test_an_interrupted_onnx_download_continues(hub: LocalHub, models: Run, tmp_path: Path) -> None:
    hub.cut_after = 5000
    broken = models("models", "fetch", "yolox_nano")
    assert broken.returncode == 1
    assert "run the command again" in broken.stderr
    assert models("models", "fetch", "yolox_nano").returncode == 0
    assert hub.ranges == ["bytes=5000-"]
    stored = (tmp_path / "models" / "onnx" / "yolox_nano.onnx").read_bytes()
    assert stored == hub.onnx
    lock = json.loads((tmp_path / "models" / LOCK).read_text())["models"]["yolox_nano.onnx"]
    assert lock["files"]["yolox_nano.onnx"]["checked_by"] == "first download"


def test_a_new_version_of_a_locked_onnx_file_is_refused_until_its_entry_is_deleted(
    hub: LocalHub, models: Run, tmp_path: Path
) -> None:
    assert models("models", "fetch", "yolox_nano").returncode == 0
    stored = tmp_path / "models" / "onnx" / "yolox_nano.onnx"
    lock = tmp_path / "models" / LOCK
    stored.unlink()
    first, hub.onnx = hub.onnx, b"a new version"
    for _ in range(2):
        refused = models("models", "fetch", "yolox_nano")
        assert refused.returncode == 1
        assert f"its SHA-256 is {sha256(hub.onnx)}, and {lock} has {sha256(first)}" in (
            refused.stderr
        )
        assert "delete the entry 'yolox_nano.onnx' from that lock file" in refused.stderr
        assert not stored.exists()
    entries = json.loads(lock.read_text())
    del entries["models"]["yolox_nano.onnx"]
    lock.write_text(json.dumps(entries))
    assert models("models", "fetch", "yolox_nano").returncode == 0
    assert stored.read_bytes() == hub.onnx


def test_an_interrupted_hub_download_continues(hub: LocalHub, models: Run) -> None:
    hub.files["model.safetensors"] = WEIGHTS * 8  # larger than the library's block
    hub.cut_after = 15_000_000
    first = models("models", "fetch", ID)
    if first.returncode:  # the library may continue by itself
        assert models("models", "fetch", ID).returncode == 0
    assert hub.ranges
    assert models("models", "verify").returncode == 0


def test_the_folder_works_on_another_machine(models: Run, tmp_path: Path) -> None:
    assert models("models", "fetch", ID, "--to", str(tmp_path / "stick")).returncode == 0
    moved = tmp_path / "elsewhere"
    shutil.move(tmp_path / "stick", moved)
    assert models("models", "verify", HELIOS_MODELS=str(moved), HF_HUB_OFFLINE="1").returncode == 0
    assert fetched(ID, moved) == moved / "someone" / "owl"


def test_the_list_names_every_model_with_licence_size_and_state(models: Run) -> None:
    assert models("models", "fetch", "yolox_nano.onnx", ID).returncode == 0
    rows = {r["id"]: r for r in json.loads(models("models", "list", "--json").stdout)["models"]}
    assert rows.keys() == {m.id for m in CATALOGUE} | {ID}
    assert (rows["yolox_nano.onnx"]["state"], rows["yolox_nano.onnx"]["bytes"]) == ("yes", 9000)
    assert rows[ID]["licence"] == "apache-2.0"
    missing = rows["google/owlv2-base-patch16-ensemble"]
    assert (missing["state"], missing["size"], missing["bytes"]) == ("no", "~616 MB", None)


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (("fetch", "someone/nothing"), 1, "has no model 'someone/nothing'"),
        (("fetch", "yolox_nan"), 2, "did you mean yolox_nano.onnx?"),
        (("verify", ID), 2, "helios models fetch someone/owl"),
        (("verify",), 2, "has no fetched model"),
    ],
)
def test_wrong_use_is_refused_in_one_sentence(
    models: Run, args: tuple[str, ...], code: int, words: str
) -> None:
    done = models("models", *args)
    assert (done.returncode, done.stderr.count("\n")) == (code, 1), done.stderr
    assert words in done.stderr


def test_a_licence_to_accept_is_named(hub: LocalHub, models: Run) -> None:
    hub.gated = True
    done = models("models", "fetch", ID)
    assert done.returncode == 1
    assert "the licence of someone/owl must be accepted first" in done.stderr
    assert "HF_TOKEN" in done.stderr


@pytest.mark.parametrize(
    "detector", ["transformers:google/owlv2-base-patch16-ensemble", "onnx:yolox_nano.onnx"]
)
def test_helios_up_names_a_missing_model_with_its_size_and_downloads_nothing(
    detector: str, hub: LocalHub, models: Run
) -> None:
    done = models("up", "--robot", "sim", "--detector", detector)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1), done.stderr
    id = detector.partition(":")[2]
    assert f"{id} (about " in done.stderr
    assert f"helios models fetch {id}" in done.stderr
    assert hub.gets == []
