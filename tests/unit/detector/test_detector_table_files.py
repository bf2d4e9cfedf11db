"""Files of noise tables: a table may be based on another."""

from pathlib import Path

import pytest
from helios_core.errors import InvalidInput
from helios_detector.simulation.frame_noise import NoiseTable, load_noise
from helios_detector.simulation.table_files import joined, shipped_tables
from helios_detector.simulation.view_noise_table import ViewNoiseTable


def written(folder: Path, name: str, text: str) -> str:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return str(path)


def views(name_or_path: str) -> ViewNoiseTable:
    table = load_noise(name_or_path)
    assert isinstance(table, ViewNoiseTable)
    return table


def test_every_shipped_table_loads_under_its_own_name():
    assert shipped_tables() == ["demo-v1", "ovmm-v1", "ovmm-v1-smooth", "ovmm-v2"]
    assert [load_noise(name).name for name in shipped_tables()] == shipped_tables()


def test_entries_override_those_of_the_base_section_by_section(tmp_path):
    path = written(
        tmp_path,
        "mine.toml",
        'base = "ovmm-v1"\nname = "mine"\n[scale]\nmiss = 0.1\n[miss.factor]\nmug = 2.0\n'
        "[score]\ntrue = [0.2, 0.9]\n",
    )
    mine, base = views(path), views("ovmm-v1")
    assert mine.name == "mine"
    assert mine.file.scale == base.file.scale.model_copy(update={"miss": 0.1})
    assert mine.file.miss.factor == base.file.miss.factor | {"mug": 2.0}
    assert mine.file.score.true == (0.2, 0.9)
    assert mine.file.confusion == base.file.confusion


def test_lists_of_the_base_are_replaced_whole():
    base = {"a": [1, 2], "b": {"c": 1, "d": {"e": 2, "f": 3}}}
    own = {"a": [3], "b": {"d": {"f": 4}}, "g": 5}
    assert joined(base, own) == {"a": [3], "b": {"c": 1, "d": {"e": 2, "f": 4}}, "g": 5}
    assert base == {"a": [1, 2], "b": {"c": 1, "d": {"e": 2, "f": 3}}}


def test_a_base_may_be_a_file_of_the_same_folder_with_a_base_of_its_own(tmp_path):
    written(tmp_path, "sub/first.toml", 'base = "demo-v1"\nname = "first"\nredrawn = 0.3\n')
    path = written(tmp_path, "sub/second.toml", 'base = "first.toml"\nscore_jitter = 0.01\n')
    table = load_noise(path)
    assert isinstance(table, NoiseTable)
    assert (table.name, table.redrawn, table.score_jitter) == ("first", 0.3, 0.01)


def test_the_digest_covers_the_file_and_its_bases(tmp_path):
    own = written(tmp_path, "own.toml", 'base = "base.toml"\nname = "own"\n')
    digests = []
    for jitter in (0.01, 0.02):
        written(tmp_path, "base.toml", f'base = "demo-v1"\nscore_jitter = {jitter}\n')
        digests.append(load_noise(own).digest)
    written(tmp_path, "own.toml", 'base = "base.toml"\nname = "other"\n')
    digests += [load_noise(own).digest, load_noise("demo-v1").digest]
    assert len(set(digests)) == 4
    assert {len(d) for d in digests} == {16}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('base = "nowhere"', r"has the base 'nowhere', which is neither.*ovmm-v1-smooth"),
        (
            'base = "mine.toml"',
            r"is based on itself \(\S+mine.toml > \S+mine.toml\).*another table",
        ),
        ('base = "other.toml"', r"is based on itself \(\S+mine.toml > \S+other.toml > \S+mine"),
        ("base = 3", r"base in the noise table .* is 3; wanted the name of a table"),
        ('base = "broken.toml"', r"noise table '\S+broken.toml' is no TOML.*line 1"),
        ('base = "ovmm-v1"\n[persistence]\nsides = "round"', r"'sectors' or 'smooth'"),
        ('base = "ovmm-v1"\nscale = 3', r"scale"),
    ],
)
def test_a_wrong_base_is_refused_with_the_cause_and_the_remedy(tmp_path, text, said):
    written(tmp_path, "other.toml", 'base = "x/../mine.toml"')
    written(tmp_path, "broken.toml", "not toml")
    path = written(tmp_path, "mine.toml", text)
    with pytest.raises(InvalidInput, match=f"(?s){said}"):
        load_noise(path)


def test_a_missing_table_is_refused_with_the_names_of_all_shipped_ones():
    for name in ("nothing", "a\0b"):
        with pytest.raises(InvalidInput, match="demo-v1, ovmm-v1, ovmm-v1-smooth") as refused:
            load_noise(name)
        assert repr(name) in refused.value.message
