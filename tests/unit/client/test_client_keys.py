"""`helios key` and the key file that it writes for the gateway."""

from __future__ import annotations

import hashlib
import stat
import tomllib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
from helios_client.cli import run
from helios_client.commands.api_keys import add_key, remove_key, replace_key
from helios_client.usage_errors import UsageError
from helios_core.errors import Conflict, HeliosError, InvalidInput
from hypothesis import given
from hypothesis import strategies as st

from tests.full_disk import fill, refuse_writing, small_disk


@given(names=st.lists(st.text(min_size=1), max_size=4, unique=True))
def test_every_key_name_is_refused_or_read_back_unchanged(
    names: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("keys") / "keys.toml"
    taken: list[str] = []
    for name in names:
        try:
            add_key(file, name, "read")
        except UsageError:
            continue
        taken.append(name)
    read = tomllib.loads(file.read_text("utf-8")) if taken else {"key": []}
    assert [entry["name"] for entry in read["key"]] == taken


def test_a_key_name_may_contain_any_printable_characters(tmp_path: Path) -> None:
    file = tmp_path / "keys.toml"
    for name in ("Küche", "🤖", 'a "b" \\c'):
        add_key(file, name, "robot")
    names = [entry["name"] for entry in tomllib.loads(file.read_text("utf-8"))["key"]]
    assert names == ["Küche", "🤖", 'a "b" \\c']
    with pytest.raises(Conflict, match="🤖"):
        add_key(file, "🤖", "read")


@pytest.mark.parametrize("name", ["", "  ", "a\nb", "\x7f", "\ud83e"])
def test_an_empty_or_unprintable_key_name_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="wanted printable text"):
        add_key(tmp_path / "keys.toml", name, "read")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content", [b"\xff\xfe", b"key = 3", b"key = [1]", b"key = []", b"[key]", b"]"]
)
def test_a_file_that_is_not_a_key_file_is_refused_and_left_unchanged(
    content: bytes, tmp_path: Path
) -> None:
    file = tmp_path / "keys.toml"
    file.write_bytes(content)
    with pytest.raises(HeliosError, match="is not a valid key file") as refused:
        add_key(file, "tablet", "read")
    assert isinstance(refused.value, InvalidInput)
    assert file.read_bytes() == content


def test_the_key_file_is_readable_only_by_its_owner_after_every_addition(tmp_path: Path) -> None:
    file = tmp_path / "keys.toml"
    for name in ("tablet", "phone"):
        add_key(file, name, "read")
        assert stat.S_IMODE(file.stat().st_mode) == 0o600


@pytest.mark.parametrize("real", [False, True])
def test_a_full_disk_leaves_the_existing_keys_unchanged(
    real: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ExitStack() as stack:
        folder = stack.enter_context(small_disk(tmp_path / "disk")) if real else tmp_path
        file = folder / "keys.toml"
        add_key(file, "tablet", "read")
        before = file.read_bytes()
        if real:
            fill(folder)
        else:
            refuse_writing(monkeypatch)
        for path in (file, folder / "other.toml"):
            with pytest.raises(InvalidInput, match="No space left"):
                add_key(path, "phone", "read")
        assert file.read_bytes() == before
        assert not (folder / "other.toml").exists()


def test_no_key_is_lost_when_keys_are_added_concurrently(tmp_path: Path) -> None:
    file, names = tmp_path / "keys.toml", [f"tablet {k}" for k in range(20)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda name: add_key(file, name, "read"), names))
    read = tomllib.loads(file.read_text("utf-8"))
    assert sorted(entry["name"] for entry in read["key"]) == sorted(names)


@given(steps=st.lists(st.sampled_from(["add", "replace", "remove"]), max_size=8), data=st.data())
def test_keys_are_added_replaced_and_removed_one_at_a_time(
    steps: list[str], data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("keys") / "keys.toml"
    keys: dict[str, str] = {}
    for step in steps:
        name = data.draw(st.sampled_from(["a", "b", '[[key]] "c"']))
        try:
            if step == "add":
                keys[name] = add_key(file, name, "task")
            elif step == "replace":
                keys[name] = replace_key(file, name)
            else:
                remove_key(file, name)
                del keys[name]
        except Conflict:
            assert name in keys
        except UsageError:
            assert name not in keys
        read = tomllib.loads(file.read_text("utf-8")).get("key", []) if file.exists() else []
        hashes = {entry["name"]: entry["sha256"] for entry in read}
        assert hashes == {n: hashlib.sha256(k.encode()).hexdigest() for n, k in keys.items()}


@pytest.mark.parametrize(
    ("line", "came"),
    [("", "no sha256"), ('sha256 = "a"\n', "the sha256 'a'"), ("sha256 = 3\n", "the sha256 '3'")],
)
@pytest.mark.parametrize("change", [replace_key, remove_key])
def test_an_entry_without_a_hash_is_neither_replaced_nor_removed(
    change: Callable[[Path, str], object], line: str, came: str, tmp_path: Path
) -> None:
    file = tmp_path / "keys.toml"
    file.write_text(f'# None\n[[key]]\nname = "tablet"\nscope = "read"\n{line}')
    before = file.read_bytes()
    with pytest.raises(InvalidInput, match=f"'tablet' in .* has {came}; wanted 64 .*; remove its"):
        change(file, "tablet")
    assert file.read_bytes() == before


@pytest.mark.parametrize("same", ["name", "sha256"])
def test_a_key_is_not_replaced_if_another_entry_has_its_name_or_hash(
    same: str, tmp_path: Path
) -> None:
    file = tmp_path / "keys.toml"
    other = {"name": "phone", "sha256": "0" * 64} | {
        same: {"name": "tablet", "sha256": "f" * 64}[same]
    }
    file.write_text(
        f'[[key]]\nname = "tablet"\nscope = "read"\nsha256 = "{"f" * 64}"\n'
        f'[[key]]\nname = "{other["name"]}"\nscope = "read"\nsha256 = "{other["sha256"]}"\n'
    )
    before = file.read_bytes()
    with pytest.raises(InvalidInput, match="another entry has the name or the sha256 of 'tablet'"):
        replace_key(file, "tablet")
    assert file.read_bytes() == before


def test_comments_and_other_entries_survive_a_removal(tmp_path: Path) -> None:
    file = tmp_path / "keys.toml"
    for name in ("a", "b", "c"):
        add_key(file, name, "read")
    file.write_text("# ours\n" + file.read_text())
    remove_key(file, "b")
    text = file.read_text()
    assert text.startswith("# ours\n[[key]]")
    assert [e["name"] for e in tomllib.loads(text)["key"]] == ["a", "c"]
    remove_key(file, "a")
    remove_key(file, "c")
    assert file.read_text() == "# ours\n"


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--scope", "operate"], "--scope task gives tasks, --scope robot also drives"),
        (["--scope", "king"], "wanted read, task, robot, admin"),
        (["--replace", "--remove"], "give one of the three"),
        (["--replace", "--scope", "read"], "--replace keeps the scope"),
        (["--remove"], "has no key 'tablet'; it has: none"),
    ],
)
def test_the_command_refuses_wrong_flags(
    tmp_path: Path, flags: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "keys.toml"
    assert run(["key", "tablet", "--file", str(file), *flags]) == 2
    assert says in capsys.readouterr().err
    assert not file.exists()


def test_the_command_replaces_and_removes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = ["--file", str(tmp_path / "keys.toml")]
    assert run(["key", "tablet", *file]) == 0
    assert run(["key", "tablet", "--replace", *file]) == 0
    first, second = capsys.readouterr().out.split()
    assert first != second
    [entry] = tomllib.loads((tmp_path / "keys.toml").read_text())["key"]
    assert entry["scope"] == "task"
    assert entry["sha256"] == hashlib.sha256(second.encode()).hexdigest()
    assert run(["key", "tablet", "--remove", *file]) == 0
    assert capsys.readouterr().out == "removed: tablet\n"
