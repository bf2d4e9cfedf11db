"""docs/explanation/paper-to-code.md names files, functions, tests and values that exist."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from helios_core.agent_presets import settings_for

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/explanation/paper-to-code.md").read_text()
PAPERS_AGENT = "helios-paper"
EQUATIONS = range(1, 13)
TABLE_3 = {
    "α_cs": 1, "α_d": 0.001, "τ_g": 0.5, "τ_b": 0.5, "τ_inc": 0.05, "od_a": 0.35, "od_g": 0.25,
    "od_b": 0.45, "cs_a": 0.3, "cs_g": 0.3, "cs_b": 0.3, "α_cpa": 3,
}  # fmt: skip
TABLES_AND_FIGURES = [
    *(f"Table {n}" for n in range(1, 9)), *(f"Figure {n}" for n in range(1, 7)),
]  # fmt: skip
NONE = "–"
COLUMNS = ["paper", "what", "code", "test", "difference"]
FILES = re.compile(r"Code: `([^`]+)`\. Tests: `([^`]+)`\.")
MENTION = re.compile(r"[Ee]q\. (\d+(?:(?:-|–|, | and )\d+)*)")


@dataclass(frozen=True)
class Row:
    """One row. code_file, test_file: those that stand above its table."""

    section: str
    cells: dict[str, str]
    code_file: str
    test_file: str

    @property
    def name(self) -> str:
        return f"{self.section}, {self.cells['paper']}: {self.cells['what']}"


def rows(page: str) -> Iterator[Row]:
    """All rows of all tables, from the top."""
    section, files, header = "", ("", ""), []
    for line in page.splitlines():
        if line.startswith("## "):
            section, files = line[3:], ("", "")
        elif found := FILES.fullmatch(line):
            files = found[1], found[2]
        elif not line.startswith("|"):
            header = []
        else:
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if not header:
                header = cells
            elif set(line) - set("|-"):
                yield Row(section, dict(zip(header, cells, strict=True)), *files)


def named(cell: str, default: str, folder: str, words: str) -> Iterator[tuple[Path, str]]:
    """File and name of everything in a cell: "`a`, `b` in `file`; `c`". words: what encloses a
    name, "`" or "*"; folder: where a file lies whose name has no folder of the repository."""
    mark = re.escape(words)
    for part in [] if cell == NONE else cell.split(";"):
        names, _, other = part.partition(" in `")
        path = other.strip(" `") or default
        if not path.startswith(("services/", "clients/", "shared/", "tests/")):
            path = f"{folder}/{path}"
        for name in re.findall(rf"{mark}([^{mark}]+){mark}", names):
            yield ROOT / path, name


def code_of(row: Row) -> list[tuple[Path, str]]:
    package = "/".join(row.code_file.split("/")[:2])
    return list(named(row.cells["code"], row.code_file, package, "`"))


def claims_of(row: Row) -> list[tuple[Path, str]]:
    folder = row.test_file.rpartition("/")[0]
    found = named(row.cells["test"], row.test_file, folder, "*")
    return [(path, f"test_{sentence.replace(' ', '_')}") for path, sentence in found]


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def node_of(path: Path, name: str) -> ast.stmt | None:
    """What a file defines under a name: function, class, method, field or constant; or None."""
    if not path.is_file():
        return None
    body, found = parsed(path).body, None
    for part in name.split("."):
        found = next((node for node in body if part in names_of(node)), None)
        if found is None:
            return None
        body = found.body if isinstance(found, ast.ClassDef) else []
    return found


def names_of(node: ast.stmt) -> list[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.AnnAssign):
        return [ast.unparse(node.target)]
    if isinstance(node, ast.Assign):
        return [ast.unparse(target) for target in node.targets]
    return []


def source_of(path: Path, node: ast.stmt) -> str:
    """With its comments."""
    return "\n".join(path.read_text().splitlines()[node.lineno - 1 : node.end_lineno])


def equations_in(text: str) -> set[int]:
    """Those that a text names: "eq. 2", "eq. 8-10", "eq. 6, 11 and 12"."""
    found: set[int] = set()
    for mention in MENTION.findall(text):
        for part in re.split(r", | and ", mention):
            first, *last = re.split(r"[-–]", part)
            found.update(range(int(first), int(last[0] if last else first) + 1))
    return found


def default_of(path: Path, name: str) -> float | None:
    """The value of a setting that the paper's agent runs with, or of another field."""
    node = node_of(path, name)
    if not isinstance(node, ast.AnnAssign) or node.value is None:
        return None
    value = node.value
    if isinstance(value, ast.Call) and ast.unparse(value.func) == "Field":
        defaults = [k.value for k in value.keywords if k.arg == "default"]
        value = (defaults or value.args)[0]
    preset = settings_for(PAPERS_AGENT)
    service = path.parent.name.removeprefix("helios_")
    own = preset.get(f"{service}.{name.rpartition('.')[2]}") if path.stem == "settings" else None
    return float(eval(ast.unparse(value), {"math": math}) if own is None else own)


def number(cell: str) -> float:
    """ "0.5 m", "30°" in radians."""
    if cell.endswith("°"):
        return math.radians(float(cell[:-1]))
    return float(cell.removesuffix(" m"))


def faults(page: str) -> list[str]:
    """What the page says that is not so, one sentence each."""
    everything = list(rows(page))
    out = [fault for row in everything for fault in [*of_row(row), *of_value(row)]]
    told = {n for row in everything if code_of(row) for n in equations_in(row.cells["paper"])}
    out += [f"no row is of eq. {n}" for n in EQUATIONS if n not in told]
    first = [row.cells["paper"] for row in everything]
    out += [f"{first.count(n)} rows are of {n}" for n in TABLES_AND_FIGURES if n not in first]
    constants = {r.cells["paper"]: r for r in everything if r.section.startswith("Table 3")}
    for name, published in TABLE_3.items():
        if name not in constants:
            out.append(f"no row of Table 3 is of {name}")
        elif number(constants[name].cells["paper's value"]) != published:
            out.append(f"{name} is {published} in the paper")
    return out


def of_row(row: Row) -> Iterator[str]:
    if [c for c in row.cells if c in COLUMNS] != COLUMNS or not all(row.cells.values()):
        yield f"{row.name}: a column is missing or empty"
        return
    code, tests = code_of(row), claims_of(row)
    if bool(code) != bool(tests) or (not code and row.cells["difference"] == NONE):
        yield f"{row.name}: wanted code and a test, or neither and a difference"
    for path, name in [*code, *tests]:
        node = node_of(path, name)
        if node is None:
            yield f"{row.name}: there is no {name} in {path.relative_to(ROOT)}"
        elif (path, name) in code:
            told = equations_in(source_of(path, node))
            for missing in sorted(equations_in(row.cells["paper"]) - told):
                yield f"{row.name}: {name} does not mention eq. {missing}"


def of_value(row: Row) -> Iterator[str]:
    if "ours" not in row.cells:
        return
    published, ours = number(row.cells["paper's value"]), number(row.cells["ours"])
    for path, name in code_of(row):
        value = default_of(path, name)
        if value is None or not math.isclose(value, ours):
            yield f"{row.name}: {name} is {value}, not {ours}"
    if (published == ours) != (row.cells["difference"] == NONE):
        yield f"{row.name}: a value that is not the paper's, and only that, has a difference"


def test_all_that_the_page_names_is_there() -> None:
    assert faults(PAGE) == []


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("`frontier_scale`", "`frontier_scales`", "there is no frontier_scales in"),
        ("`Looking.best_view`", "`Looking.worst_view`", "there is no Looking.worst_view in"),
        ("fusion/semantics.py", "fusion/semantic.py", "in services/helios_objectmap/fusion/sem"),
        ("*the frontier scale is the", "*the frontier scale was the", "test_the_frontier_scale_wa"),
        ("test_planner_decisions.py", "test_planner_decides.py", "planner/test_planner_decides.py"),
        ("| eq. 9 |", "| 3.2 |", "no row is of eq. 9"),
        ("| eq. 8 |", "| eq. 9 |", "estimated_value does not mention eq. 9"),
        ("| eq. 12 |", "| eq. 13 |", "does not mention eq. 13"),
        ("| 0.001 | 0.001 |", "| 0.001 | 0.002 |", "Settings.alpha_d is 0.001, not 0.002"),
        ("| 0.001 | 0.001 |", "| 0.002 | 0.001 |", "α_d is 0.001 in the paper"),
        ("| 30° | 30° |", "| 30° | 20° |", "MotionRules.max_turn_rad is"),
        ("| 0.5 m | 0.07 m |", "| 0.07 m | 0.07 m |", "and only that, has a difference"),
        ("| τ_inc | Least", "| τ | Least", "no row of Table 3 is of τ_inc"),
        ("| Table 7 |", "| 6.6 |", "0 rows are of Table 7"),
        ("| Figure 4 |", "| 6.2 |", "0 rows are of Figure 4"),
        ("| `entropy` |", "| – |", "wanted code and a test"),
        ("| The hierarchical map |", "| |", "a column is missing or empty"),
    ],
)  # fmt: skip
def test_each_fault_of_the_page_is_found(old: str, new: str, fault: str) -> None:
    assert old in PAGE
    assert any(fault in found for found in faults(PAGE.replace(old, new)))


def test_mentions_of_equations_are_read_in_all_their_forms() -> None:
    assert equations_in("(eq. 2)") == {2}
    assert equations_in("Eq. 8-10 and the rest") == {8, 9, 10}
    assert equations_in("eq. 6, 11 and 12, appendix") == {6, 11, 12}
    assert equations_in("eq. 2–5; eq. 7") == {2, 3, 4, 5, 7}
    assert equations_in("section 3.1.3, figure 4, 12 rows") == set()
