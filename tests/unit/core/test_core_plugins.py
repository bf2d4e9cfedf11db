"""Plug-ins are found and created; an error names the step that failed."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from pathlib import Path

import pytest
from helios_core.errors import InvalidInput, Unavailable
from helios_core.plugins import DETECTORS, Kind, PluginReference, check_there, find, load, make

SOURCE = """
from helios_core.errors import Unavailable
from tests.unit.core.test_core_plugins import Tool
class Hammer(Tool):
    def __init__(self, argument="", options=None): self.given = argument, options
    def use(self): ...
class ByOrder(Hammer):
    def __init__(self, first, second): self.given = first, second
class Bare(Tool):
    def use(self): ...
class Half(Tool): ...
class Broken(Hammer):
    def __init__(self): raise ValueError("no handle")
class Away(Hammer):
    def __init__(self): raise Unavailable("plug it in")
class Demanding(Hammer):
    def __init__(self, port): ...
class Other: ...
def forge(argument): return Hammer(argument)
def nothing(): return 3
number = 3
"""


class Tool(ABC):
    """The base class of the plug-ins of this test."""

    @abstractmethod
    def use(self) -> None: ...


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with modules in it; the folder is not on the module path."""
    (tmp_path / "tools_of_a_test.py").write_text(SOURCE)
    (tmp_path / "slip_of_a_test.py").write_text("class Robot(\n")
    (tmp_path / "quits_of_a_test.py").write_text("raise SystemExit(3)\n")
    (tmp_path / "wants_of_a_test.py").write_text("import surely_not_installed\n")
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p not in ("", str(Path.cwd()))])
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3]))  # SOURCE imports this file
    monkeypatch.chdir(tmp_path)
    for name in [n for n in sys.modules if n.endswith("_of_a_test")]:
        monkeypatch.delitem(sys.modules, name)
    return tmp_path


def made(spec: str, **offered: object) -> object:
    named = find(DETECTORS, spec)
    assert named is not None
    return make(DETECTORS, named, Tool, {"argument": named.argument, "options": 7} | offered)


@pytest.mark.parametrize(
    ("spec", "given"),
    [
        ("tools_of_a_test:Hammer", ("", 7)),
        ("tools_of_a_test:Hammer:a:b", ("a:b", 7)),
        ("tools_of_a_test:ByOrder:x", ("x", 7)),
        ("tools_of_a_test:forge:x", ("x", None)),
    ],
)
def test_a_plug_in_of_the_current_folder_gets_the_arguments_that_its_signature_names(
    folder: Path, spec: str, given: tuple[object, ...]
) -> None:
    assert vars(made(spec))["given"] == given


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("surely_not_there:X", r"no package or module 'surely_not_there', neither in .*PYTHONPATH"),
        ("tools_of_a_test.sub:X", "there is no package or module 'tools_of_a_test.sub'"),
        ("wants_of_a_test:X", "import of wants_of_a_test failed .*surely_not_installed"),
        ("slip_of_a_test:X", r"SyntaxError in .*slip_of_a_test.py, line 1"),
        ("quits_of_a_test:X", "SystemExit: 3"),
        ("tools_of_a_test:Hamer", "has no 'Hamer'; did you mean Hammer"),
        ("tools_of_a_test:", "is no package:attribute"),
        ("a b:c", "is no package:attribute"),
        ("tools_of_a_test:Other", "is the class Other; wanted a class that derives from .*Tool"),
        ("tools_of_a_test:number", "is of type int; wanted"),
        ("tools_of_a_test:nothing", "returned of type int; wanted"),
        ("tools_of_a_test:Half", "lacks the method use"),
        ("tools_of_a_test:Broken", "cannot be made .ValueError: no handle"),
        ("tools_of_a_test:Demanding", "cannot be made .*port.*may ask for argument, options"),
        ("tools_of_a_test:Bare:x", "takes no argument, but 'x' came"),
    ],
)
def test_a_plug_in_that_cannot_be_created_reports_the_failed_step(
    folder: Path, spec: str, said: str
) -> None:
    with pytest.raises(InvalidInput, match=said):
        made(spec)


def test_a_plug_ins_own_error_is_passed_on(folder: Path) -> None:
    with pytest.raises(Unavailable, match="plug it in"):
        made("tools_of_a_test:Away")


def test_checking_that_a_plug_in_exists_runs_no_code(folder: Path) -> None:
    check_there(DETECTORS, "quits_of_a_test:X")
    assert "quits_of_a_test" not in sys.modules
    with pytest.raises(InvalidInput, match="no package or module 'surely_not_there'"):
        check_there(DETECTORS, "surely_not_there:X")


def test_a_plain_name_refers_to_an_entry_point_or_nothing(folder: Path) -> None:
    assert find(DETECTORS, "paint:x") == PluginReference(
        "paint:x", "helios_examples.paint_detector", "open_paint", "x"
    )
    assert find(DETECTORS, "nobody") is None
    with pytest.raises(InvalidInput, match=r"no detector 'nobody'.*offer paint"):
        check_there(DETECTORS, "nobody")
    with pytest.raises(InvalidInput, match=r"no toy 'nobody'; wanted package:attribute$"):
        check_there(Kind("toy", "helios.toys"), "nobody")


def test_load_returns_the_attribute_itself(folder: Path) -> None:
    named = find(DETECTORS, "tools_of_a_test:number")
    assert named is not None
    assert load(DETECTORS, named) == 3
