"""`helios key`: what it writes the gateway reads."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from helios_client.commands.keys import add_key
from helios_client.wrong_use import WrongUse
from helios_core.errors import Conflict, HeliosError, InvalidInput
from hypothesis import given
from hypothesis import strategies as st


@given(names=st.lists(st.text(min_size=1), max_size=4, unique=True))
def test_every_name_is_refused_or_comes_back_as_it_is(
    names: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("keys") / "keys.toml"
    taken: list[str] = []
    for name in names:
        try:
            add_key(file, name, "read")
        except WrongUse:
            continue
        taken.append(name)
    read = tomllib.loads(file.read_text("utf-8")) if taken else {"key": []}
    assert [entry["name"] for entry in read["key"]] == taken


def test_a_name_may_have_any_letters(tmp_path: Path) -> None:
    file = tmp_path / "keys.toml"
    for name in ("Küche", "🤖", 'a "b" \\c'):
        add_key(file, name, "operate")
    names = [entry["name"] for entry in tomllib.loads(file.read_text("utf-8"))["key"]]
    assert names == ["Küche", "🤖", 'a "b" \\c']
    with pytest.raises(Conflict, match="🤖"):
        add_key(file, "🤖", "read")


@pytest.mark.parametrize("name", ["", "  ", "a\nb", "\x7f", "\ud83e"])
def test_a_name_that_cannot_be_read_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(WrongUse, match="can be read"):
        add_key(tmp_path / "keys.toml", name, "read")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content", [b"\xff\xfe", b"key = 3", b"key = [1]", b"key = []", b"[key]", b"]"]
)
def test_a_file_that_is_none_of_keys_is_left_as_it_is(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "keys.toml"
    file.write_bytes(content)
    with pytest.raises(HeliosError, match="is no file of keys") as refused:
        add_key(file, "tablet", "read")
    assert isinstance(refused.value, InvalidInput)
    assert file.read_bytes() == content
