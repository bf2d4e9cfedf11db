"""Tests that the files, modules, commands and options named in the documents exist."""

from __future__ import annotations

import importlib
import importlib.util
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from helios_client.cli import app as helios_app
from helios_client.leading_options import leading
from helios_core.settings import ServiceSettings
from helios_eval.eval_command import app as eval_app

from tests.support import settings_of

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("services", "shared", "clients")
FOLDERS = (*SOURCES, "docs", "tests", "scripts", "deploy", ".github", ".ci")
SUFFIXES = ("py", "proto", "toml", "json5", "yaml", "sh", "md", "json", "png", "svg")
# Files that a reader writes, a command creates, or another package contains; none is ours.
OF_THE_READER = {
    "keys.toml", "helios.toml", "meta.json", "result.json", "results.json", "run.json",
    "sbom.cdx.json",
    "models.lock.json",
    "report.md", "calibration.md", "attributions.md", "realism.md", "beliefs.json",
    "summary.json", "objects.json", "psi.png", "gaussians.png", "map.yaml", "bench.json",
    "drive.py", "frames/000012.png", "current/ATTRIBUTIONS.md",
    "memory.json", "memory.md", "memory.png",
    "helios_core.proto", "foxglove/RawImage.proto", "names.toml", "router.json5",
    "sessions/NAME.json5", "certs/sessions/NAME.json5", "certs/sessions/bridge.robot.json5",
}  # fmt: skip
PATH = re.compile(
    rf"[\w.-]+(?:/[\w.-]+)*\.(?:{'|'.join(SUFFIXES)})|(?:{'|'.join(FOLDERS)})/[\w./-]+"
)
TUTORIAL = "docs/tutorials/"  # files there are mostly the reader's own


def documents() -> list[Path]:
    """Every page of prose, without the changelog and generated reports."""
    pages = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md"), *(ROOT / ".github").rglob("*.md")]
    left_out = ("CHANGELOG.md", "THIRD_PARTY_NOTICES.md", "report.md")
    return sorted(page for page in pages if page.name not in left_out)


PAGES = {str(page.relative_to(ROOT)): page.read_text() for page in documents()}


@cache
def tracked() -> tuple[str, ...]:
    """All files of the repository, including new ones."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return tuple(line for line in listed.stdout.splitlines() if (ROOT / line).exists())


def exists(path: str) -> bool:
    """Whether a file or folder of the repository has this path, or a path that ends with it."""
    path = path.rstrip("/")
    if (ROOT / path).exists():
        return True
    return any(f"/{file}".endswith(f"/{path}") or f"/{path}/" in f"/{file}" for file in tracked())


@cache
def parts_of(page: str) -> tuple[str, tuple[tuple[str, str], ...]]:
    """The text between the fenced blocks, and each block with its language."""
    prose: list[str] = []
    blocks: list[tuple[str, list[str]]] = []
    fence = ""
    for line in page.splitlines():
        opened = re.match(r" *(`{3,})(\S*)", line)
        if fence and line.strip() == fence:
            fence = ""
        elif fence:
            blocks[-1][1].append(line)
        elif opened:
            fence = opened[1]
            blocks.append((opened[2], []))
        else:
            prose.append(line)
    return "\n".join(prose), tuple((kind, "\n".join(lines)) for kind, lines in blocks)


def inline_code(page: str) -> list[str]:
    return [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", parts_of(page)[0])]


def paths_named(name: str, page: str) -> Iterator[str]:
    """Paths in inline code that refer to a file of the repository."""
    for code in inline_code(page):
        if not PATH.fullmatch(code) or code in OF_THE_READER:
            continue
        inside = code.startswith(tuple(f"{folder}/" for folder in FOLDERS))
        if code.startswith(("runs/", "site/")) or (name.startswith(TUTORIAL) and not inside):
            continue
        yield code


@dataclass(frozen=True)
class Command:
    """A command line in a page, split into words."""

    page: str
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.words)}"

    @property
    def options(self) -> list[str]:
        """Names of the long options, without values."""
        return [w.partition("=")[0] for w in self.words if re.fullmatch(r"--[a-z][\w-]*(=.*)?", w)]


def lines_of(page: str) -> Iterator[str]:
    """Inline code, and lines of code blocks without comments; continued lines are joined."""
    yield from inline_code(page)
    for kind, block in parts_of(page)[1]:
        if kind not in ("", "bash", "sh", "console"):
            continue
        for line in re.sub(r"\\\n\s*", " ", block).splitlines():
            yield re.sub(r"(^|\s)#.*$", "", line)


def commands(start: str) -> Iterator[Command]:
    """All commands that begin with these words, also after variables and in loops."""
    for name, page in PAGES.items():
        for line in lines_of(page):
            for part in re.split(r"&&|\|\||[;|…]|\bdo\b", line):
                bare = re.sub(r'"[^"]*"', '"…"', part).strip().strip("`[]()").removeprefix("$ ")
                bare = re.sub(r"^(?:[A-Z_]+=\S* +|taskset -c \d+ +|time +)*", "", bare)
                if bare.startswith(f"{start} "):
                    yield Command(name, tuple(bare.split()[len(start.split()) :]))


def commands_by_name(command: Any) -> dict[str, Any]:
    return dict(getattr(command, "commands", {}))


def options_of(command: Any) -> set[str]:
    return {name for p in command.params for name in (*p.opts, *p.secondary_opts)} | {"--help"}


def fault_in(words: list[str], command: Any) -> str:
    """The fault in the words after a click command; "" if there is none."""
    while inner := commands_by_name(command):
        if not words:
            return ""
        if words[0].startswith("-"):
            break
        if words[0] not in inner:
            return f"there is no command {words[0]!r}"
        command, words = inner[words[0]], words[1:]
    known = options_of(command)
    options = Command("", tuple(words)).options
    return "; ".join(f"there is no option {o}" for o in options if o not in known)


HELIOS = typer.main.get_command(helios_app)
EVAL = typer.main.get_command(eval_app)
PLACEHOLDERS = {"…", "X", "COMMAND", "up`"}  # placeholders in prose for any command


def fault_of(command: Command) -> str:
    words = [word.strip(",.:()[]`'") for word in leading(command.words)[1]]
    words = [word for word in words if word]
    if (
        not words
        or words[0] in PLACEHOLDERS
        or not re.fullmatch(r"--?[\w-]+|[a-z][a-z-]*", words[0])
    ):
        return ""
    if words[0] == "eval":
        return fault_in(words[1:], EVAL)
    return fault_in(words, HELIOS)


@pytest.mark.parametrize("name", PAGES)
def test_each_file_named_in_a_page_exists(name: str) -> None:
    missing = sorted({path for path in paths_named(name, PAGES[name]) if not exists(path)})
    assert not missing, f"{name} names files that there are not: {missing}"


def test_each_helios_command_and_its_options_exist() -> None:
    found = list(commands("helios"))
    assert len(found) > 100
    wrong = {f"{command}: {fault}" for command in found if (fault := fault_of(command))}
    assert not wrong, "\n".join(sorted(wrong))


def importable(dotted: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    parts = dotted.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        try:
            for name in parts[end:]:
                found = getattr(found, name)
        except AttributeError:
            return False
        return True
    return False


def test_each_dotted_name_of_our_packages_can_be_imported() -> None:
    packages = "|".join(p.name for s in SOURCES for p in (ROOT / s).glob("helios_*"))
    dotted = re.compile(rf"((?:{packages})(?:\.\w+)+)(?:\(.*\))?")
    named = {
        (page, found[1])
        for page, text in PAGES.items()
        for code in inline_code(text)
        if (found := dotted.fullmatch(code)) and not found[1].endswith((".py", ".proto"))
    }
    assert len(named) > 20
    wrong = sorted(f"{page}: {name}" for page, name in named if not importable(name))
    assert not wrong, "\n".join(wrong)


def source_of(module: str) -> Path | None:
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        return None
    origin = Path(spec.origin)
    return origin.with_name("__main__.py") if origin.name == "__init__.py" else origin


def options_of_module(module: str, source: str) -> set[str]:
    """Option names in the source (argparse or typer) and in the service's settings."""
    known = {*re.findall(r'"(--[a-z][\w-]*)"', source), "--help"}
    known |= {f"--{name.replace('_', '-')}" for name in re.findall(r"^    (\w+): ", source, re.M)}
    if (
        importlib.util.find_spec(f"{module.split('.')[0]}.settings") is not None
        and "." not in module
    ):
        own: type[ServiceSettings] = settings_of(module)
        fields = {f"--{field.replace('_', '-')}" for field in own.model_fields}
        known |= fields | {f"--no-{field[2:]}" for field in fields} | {"--config"}
    return known


def test_each_module_run_in_a_page_exists_with_its_options() -> None:
    found = [c for c in commands("python -m") if c.words[0].startswith(("helios", "tests."))]
    assert len(found) > 20
    wrong: set[str] = set()
    for command in found:
        module = command.words[0].strip(",.:()`")
        source = source_of(module)
        if source is None or not source.is_file():
            wrong.add(f"{command}: there is no module {module} to run")
            continue
        known = options_of_module(module, source.read_text())
        wrong |= {f"{command}: no option {o}" for o in command.options if o not in known}
    assert not wrong, "\n".join(sorted(wrong))


def test_each_script_run_in_a_page_exists() -> None:
    scripts = [c.words[0] for c in commands("python") if c.words[0].startswith(FOLDERS)]
    assert scripts
    assert not [script for script in scripts if not exists(script)]


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("task --json", ""),
        ("tusk", "there is no command 'tusk'"),
        ("task --jsn", "there is no option --jsn"),
        ("map save home.zip", ""),
        ("map keep", "there is no command 'keep'"),
        ("eval ovmm --agents helios", ""),
        ("eval ovmm --agent helios", "there is no option --agent"),
    ],
)
def test_a_wrong_command_is_found(line: str, fault: str) -> None:
    assert fault_of(Command("a page", tuple(line.split()))) == fault


def test_paths_of_the_repository_are_distinguished_from_those_of_the_reader() -> None:
    page = "`services/helios_planner/gone.py`, `runs/x.png`, `executor.py`, `a word`, `keys.toml`"
    assert list(paths_named("docs/index.md", page)) == [
        "services/helios_planner/gone.py",
        "executor.py",
    ]
    assert not exists("services/helios_planner/gone.py")
    assert exists("tasks/executor.py")
    assert exists("services/helios_planner/")
