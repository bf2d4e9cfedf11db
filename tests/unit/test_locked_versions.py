"""constraints.txt pins all packages of the tests, and the tests run with these versions."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from scripts.lock_versions import pins

TEXT = (Path(__file__).parents[2] / "constraints.txt").read_text()
PINNED: dict[str, str] = {
    canonicalize_name(name): pinned
    for name, _, pinned in (line.partition("==") for line in TEXT.splitlines() if "==" in line)
}


def required(name: str, extras: frozenset[str], seen: set[tuple[str, str]]) -> Iterator[str]:
    """Packages that an installed package needs with these extras, and what they need in turn."""
    for text in distribution(name).requires or ():
        one = Requirement(text)
        wanted = ("", *extras)
        if one.marker and not any(one.marker.evaluate({"extra": e}) for e in wanted):
            continue
        own = canonicalize_name(one.name)
        for extra in one.extras or {""}:
            if (own, extra) not in seen:
                seen.add((own, extra))
                yield own
                yield from required(own, frozenset({extra} - {""}), seen)


def test_every_package_of_the_tests_has_the_pinned_version() -> None:
    found = set(required("helios-ovmm", frozenset({"all", "dev"}), set())) - {"helios-ovmm"}
    assert len(found) > 100
    for name in sorted(found):
        try:
            installed = version(name).partition("+")[0]
        except PackageNotFoundError:  # an optional one of another package
            continue
        assert PINNED.get(name) == installed, f"{name} {installed} is installed; run `make lock`"


def test_every_allowed_numpy_can_forbid_pickles_in_npz_files() -> None:
    """One before 2.2 takes `allow_pickle=False` for an array and writes it to the file."""
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    (numpy,) = (r for r in map(Requirement, project["dependencies"]) if r.name == "numpy")
    assert "2.1.3" not in numpy.specifier
    assert "2.2.0" in numpy.specifier


def test_chosen_versions_and_local_parts_are_no_pins_of_their_own() -> None:
    frozen = "Torch==2.13.0+cpu\nzlib-ng==1.0+local\nattrs==26.1.0\n-e git+x\nnumpy @ file:///x\n"
    assert pins(frozen, "# why\ntorch==2.13.0\n") == ["attrs==26.1.0", "zlib-ng==1.0"]
