"""Tests that docs/explanation/paper-to-code.md names only existing code, tests and values."""

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
    *(f"Table {n}" for n in range(1, 9)),
    *(f"Figure {n}" for n in range(1, 7)),
]
NONE = "–"
COLUMNS = ["paper", "what", "code", "test", "verdict", "difference"]
VERDICTS = ("exact", "exact, with", "ours differs", "left open", "not built", "not run")
MENTION = re.compile(r"[Ee]q\. (\d+(?:(?:-|–|, | and )\d+)*)")


@dataclass(frozen=True)
class Row:
    """One row, with the files listed above its table."""

    section: str
    cells: dict[str, str]
    code_files: list[Path]
    test_files: list[Path]

    @property
    def name(self) -> str:
        return f"{self.section}, {self.cells['paper']}: {self.cells['what']}"

    @property
    def code(self) -> list[str]:
        return re.findall(r"`([^`]+)`", self.cells["code"])

    @property
    def tests(self) -> list[str]:
        found = re.findall(r"\*([^*]+)\*", self.cells["test"])
        return [f"test_{sentence.replace(' ', '_')}" for sentence in found]


def files_in(section: str, kind: str) -> list[Path]:
    """The files in "- Code in `folder`: `a.py`, `b.py`; in `folder`: `c.py`"."""
    found = re.search(rf"^- {kind} (in .*(?:\n  .*)*)", section, re.MULTILINE)
    groups = re.findall(r"in\s+`([^`]+)`:((?:\s+`[^`]+`,?)+)", found[1]) if found else []
    return [
        ROOT / folder / name for folder, names in groups for name in re.findall(r"`(.+?)`", names)
    ]


def rows(page: str) -> Iterator[Row]:
    """All rows of all tables in order."""
    for section in page.split("\n## ")[1:]:
        title = section.partition("\n")[0]
        files = files_in(section, "Code"), files_in(section, "Tests")
        lines = [line for line in section.splitlines() if line.startswith("|")]
        cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
        for row in cells[2:]:
            yield Row(title, dict(zip(cells[0], row, strict=True)), *files)


def found_in(files: list[Path], name: str) -> tuple[list[Path], ast.stmt | None]:
    """The files that define a name, and its definition in the first file."""
    nodes = [(path, node_of(path, name)) for path in files]
    there = [(path, node) for path, node in nodes if node is not None]
    return [path for path, _ in there], there[0][1] if there else None


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def node_of(path: Path, name: str) -> ast.stmt | None:
    """A file's definition of a name: function, class, method, field or constant; or None."""
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
    """The source of a node, with its comments."""
    return "\n".join(path.read_text().splitlines()[node.lineno - 1 : node.end_lineno])


def equations_in(text: str) -> set[int]:
    """The equations that a text names: "eq. 2", "eq. 8-10", "eq. 6, 11 and 12"."""
    found: set[int] = set()
    for mention in MENTION.findall(text):
        for part in re.split(r", | and ", mention):
            first, *last = re.split(r"[-–]", part)
            found.update(range(int(first), int(last[0] if last else first) + 1))
    return found


def default_of(path: Path, name: str) -> float | None:
    """The value of a setting for the paper's agent, or the default of another field."""
    node = node_of(path, name)
    if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
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
    """The faults of the page, one sentence each."""
    everything = list(rows(page))
    out = [fault for row in everything for fault in [*row_faults(row), *value_faults(row)]]
    reported = {n for row in everything if row.code for n in equations_in(row.cells["paper"])}
    out += [f"no row is of eq. {n}" for n in EQUATIONS if n not in reported]
    first = [row.cells["paper"] for row in everything]
    out += [f"no row is of {n}" for n in TABLES_AND_FIGURES if n not in first]
    constants = {r.cells["paper"]: r for r in everything if r.section.startswith("Table 3")}
    for name, published in TABLE_3.items():
        if name not in constants:
            out.append(f"no row of Table 3 is of {name}")
        elif number(constants[name].cells["paper's value"]) != published:
            out.append(f"{name} is {published} in the paper")
    for title in dict.fromkeys(row.section for row in everything):
        out += file_faults(title, [row for row in everything if row.section == title])
    return out


def file_faults(title: str, of_section: list[Row]) -> Iterator[str]:
    code, tests = of_section[0].code_files, of_section[0].test_files
    used = {p for row in of_section for name in row.code for p in found_in(code, name)[0]}
    used |= {p for row in of_section for name in row.tests for p in found_in(tests, name)[0]}
    for path in [*code, *tests]:
        if path not in used:
            yield f"{title}: no row uses {path.relative_to(ROOT)}"


def row_faults(row: Row) -> Iterator[str]:
    if [c for c in row.cells if c in COLUMNS] != COLUMNS or not all(row.cells.values()):
        yield f"{row.name}: a column is missing or empty"
        return
    if bool(row.code) != bool(row.tests) or not (row.code or row.cells["difference"] != NONE):
        yield f"{row.name}: wanted code and a test, or neither and a difference"
    yield from verdict_faults(row)
    for files, names in ((row.code_files, row.code), (row.test_files, row.tests)):
        for name in names:
            where, _ = found_in(files, name)
            if len(where) != 1:
                yield f"{row.name}: {len(where)} of the files above the table have {name}"
    for name in row.code:
        where, node = found_in(row.code_files, name)
        reported = equations_in(source_of(where[0], node)) if node else set(EQUATIONS)
        for missing in sorted(equations_in(row.cells["paper"]) - reported):
            yield f"{row.name}: {name} does not mention eq. {missing}"


def verdict_faults(row: Row) -> Iterator[str]:
    verdict = row.cells["verdict"]
    if verdict not in VERDICTS:
        yield f"{row.name}: {verdict!r} is no verdict"
    if (verdict == "exact") != (row.cells["difference"] == NONE):
        yield f"{row.name}: exact, and only that, has no difference"
    if verdict == "not built" and row.code:
        yield f"{row.name}: it is not built and has code"
    if verdict.startswith("exact") and not row.code:
        yield f"{row.name}: {verdict!r} without code"


def value_faults(row: Row) -> Iterator[str]:
    if "ours" not in row.cells:
        return
    published, ours = number(row.cells["paper's value"]), number(row.cells["ours"])
    for name in row.code:
        where, _ = found_in(row.code_files, name)
        value = default_of(where[0], name) if where else None
        if value is None or not math.isclose(value, ours):
            yield f"{row.name}: {name} is {value}, not {ours}"
    if (published == ours) != (row.cells["difference"] == NONE):
        yield f"{row.name}: a value that is not the paper's, and only that, has a difference"


def test_the_page_has_no_faults() -> None:
    assert faults(PAGE) == []


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("`frontier_scale`", "`frontier_scales`", "have frontier_scales"),
        ("`ViewPlanner.best_view`", "`ViewPlanner.worst_view`", "have ViewPlanner.worst_view"),
        ("fusion/semantics.py", "fusion/semantic.py", "fusion/semantic.py"),
        ("*the frontier scale is the", "*the scale is the", "have test_the_scale_is"),
        ("test_planner_decisions.py", "test_planner_decides.py", "/test_planner_decides.py"),
        ("| eq. 9 |", "| 3.2 |", "no row is of eq. 9"),
        ("| eq. 8 |", "| eq. 7 |", "estimated_value does not mention eq. 7"),
        ("| eq. 12 |", "| eq. 13 |", "does not mention eq. 13"),
        ("| 0.001 | 0.001 |", "| 0.001 | 0.002 |", "Settings.alpha_d is 0.001, not 0.002"),
        ("| 0.001 | 0.001 |", "| 0.002 | 0.001 |", "α_d is 0.001 in the paper"),
        ("| 30° | 30° |", "| 30° | 20° |", "MotionRules.max_turn_rad is"),
        ("| exact |", "| right |", "'right' is no verdict"),
        ("| exact | – |", "| ours differs | – |", "exact, and only that, has no difference"),
        ("| not built | OWL", "| exact, with | OWL", "'exact, with' without code"),
        ("| ours differs | 100 of", "| not built | 100 of", "it is not built and has code"),
        ("| 0.5 m | 0.5 m |", "| 0.07 m | 0.5 m |", "and only that, has a difference"),
        ("| τ_inc | Least", "| τ | Least", "no row of Table 3 is of τ_inc"),
        ("| Table 7 |", "| 6.6 |", "no row is of Table 7"),
        ("| Figure 4 |", "| 6.2 |", "no row is of Figure 4"),
        ("| `entropy` |", "| – |", "wanted code and a test"),
        ("| The hierarchical map |", "| |", "a column is missing or empty"),
    ],
)
def test_each_fault_of_the_page_is_found(old: str, new: str, fault: str) -> None:
    assert old in PAGE
    assert any(fault in found for found in faults(PAGE.replace(old, new)))


def test_mentions_of_equations_are_parsed_in_all_forms() -> None:
    assert equations_in("(eq. 2)") == {2}
    assert equations_in("Eq. 8-10 and the rest") == {8, 9, 10}
    assert equations_in("eq. 6, 11 and 12, appendix") == {6, 11, 12}
    assert equations_in("eq. 2–5; eq. 7") == {2, 3, 4, 5, 7}
    assert equations_in("section 3.1.3, figure 4, 12 rows") == set()
