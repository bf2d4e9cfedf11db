"""Loading of plug-ins from other packages, by `package:attribute` or by entry point.

    package:Attribute            found on the module path or in the current folder
    package:Attribute:ARGUMENT   a detector or a scorer may take one argument
    NAME or NAME:ARGUMENT        an entry point of the kind's group, of an installed package

A plug-in that cannot be loaded raises InvalidInput; its text names the failed step and the remedy.
"""

from __future__ import annotations

import importlib
import inspect
import logging
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.machinery import PathFinder
from importlib.metadata import entry_points
from typing import Any, TypeVar, cast

from helios_core.errors import HeliosError, InvalidInput

log = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True)
class Kind:
    """One kind of plug-in."""

    name: str  # for messages: "detector"
    group: str  # entry point group

    def entry_names(self) -> tuple[str, ...]:
        """Entry points of installed packages, in alphabetical order."""
        return tuple(sorted({entry.name for entry in entry_points(group=self.group)}))


DETECTORS = Kind("detector", "helios.detectors")
SCORERS = Kind("scorer", "helios.scorers")
AGENTS = Kind("agent", "helios.agents")
ROBOTS = Kind("robot", "helios.robots")
KINDS = (DETECTORS, SCORERS, AGENTS, ROBOTS)


@dataclass(frozen=True)
class PluginReference:
    """Plug-in named by a setting: an attribute of a module, and an argument."""

    spec: str  # text of the setting
    module: str
    attribute: str
    argument: str = ""


def find(kind: Kind, spec: str) -> PluginReference | None:
    """Plug-in that a setting names; None for a plain name without an entry point."""
    first, colon, rest = spec.partition(":")
    attribute, _, argument = rest.partition(":")
    for entry in entry_points(group=kind.group, name=first):
        if (entry.module, entry.attr) == (first, attribute):  # full package:attribute
            break
        return PluginReference(spec, entry.module, entry.attr, rest)
    if not colon:
        return None
    return PluginReference(spec, first, attribute, argument)


def check_there(kind: Kind, spec: str) -> None:
    """Raise InvalidInput if the package of a plug-in does not exist; runs none of its code."""
    named = find(kind, spec)
    if named is None:
        raise InvalidInput(
            f"there is no {kind.name} {spec!r}; wanted package:attribute{_offered(kind)}"
        )
    _check_words(kind, named)
    top = named.module.partition(".")[0]
    if top in sys.modules or top in sys.builtin_module_names:
        return
    if PathFinder.find_spec(top, [*sys.path, os.getcwd()]) is None:
        raise InvalidInput(_not_found(kind, spec, top))


def load(kind: Kind, named: PluginReference) -> Any:
    """The attribute itself. Raises InvalidInput if the module fails to import or lacks it."""
    _check_words(kind, named)
    _look_here()
    try:
        module = importlib.import_module(named.module)
    except ModuleNotFoundError as error:
        if error.name and f"{named.module}.".startswith(f"{error.name}."):
            raise InvalidInput(_not_found(kind, named.spec, error.name)) from error
        raise InvalidInput(_not_imported(kind, named, error)) from error
    except (Exception, SystemExit) as error:  # an import runs foreign code
        log.error("%s %s: the import failed", kind.name, named.spec, exc_info=error)
        raise InvalidInput(_not_imported(kind, named, error)) from error
    if not hasattr(module, named.attribute):
        public = [name for name in vars(module) if not name.startswith("_")]
        near = get_close_matches(named.attribute, public, 1)
        hint = f"did you mean {near[0]}?" if near else "name a class or a value that it defines"
        raise InvalidInput(
            f"{kind.name} {named.spec!r}: module {named.module} has no {named.attribute!r}; {hint}"
        )
    return getattr(module, named.attribute)


def load_factory(kind: Kind, named: PluginReference, base: type[T]) -> Callable[..., T]:
    """Class of a plug-in, or function that returns an instance; does not call it.

    Raises InvalidInput if it cannot be imported, has another type, or lacks methods.
    """
    factory = load(kind, named)
    if not callable(factory) or (isinstance(factory, type) and not issubclass(factory, base)):
        raise InvalidInput(
            f"{kind.name} {named.spec!r} is {described(factory)}; wanted {_class_of(base)}, or a "
            "function that returns an instance of one"
        )
    if missing := sorted(getattr(factory, "__abstractmethods__", ())):
        many = "methods" if len(missing) > 1 else "method"
        raise InvalidInput(
            f"{kind.name} {named.spec!r} lacks the {many} {', '.join(missing)}; write every "
            f"abstract method of {base.__module__}.{base.__name__}"
        )
    return cast("Callable[..., T]", factory)


def make(
    kind: Kind,
    named: PluginReference,
    base: type[T],
    offered: Mapping[str, Any],
    *,
    into: Callable[[object], str] = lambda made: "",
) -> T:
    """Instance of a plug-in, from its class or its function.

    offered: arguments that the constructor may take by parameter name. A constructor with exactly
    as many required parameters, all with other names, gets all arguments in this order. into:
    returns the reason if an instance is still not acceptable, else "".
    Raises InvalidInput if the instance cannot be made, and the HeliosErrors of the constructor.
    """
    factory = load_factory(kind, named, base)
    try:
        made = factory(**_arguments(kind, named, factory, offered))
    except HeliosError:
        raise
    except (Exception, SystemExit) as error:
        log.error("%s %s cannot be made", kind.name, named.spec, exc_info=error)
        raise InvalidInput(
            f"{kind.name} {named.spec!r} cannot be made ({_reason(error)}); its constructor may "
            f"ask for {', '.join(offered)} by name, and needs a default for anything else"
        ) from error
    if not isinstance(made, base):
        raise InvalidInput(
            f"{kind.name} {named.spec!r} returned {described(made)}; wanted {_class_of(base)}"
        )
    if why := into(made):
        raise InvalidInput(f"{kind.name} {named.spec!r}: {why}")
    return made


def list_names(kind: Kind) -> str:
    """Entry points of a kind, separated by commas; empty if there are none."""
    return ", ".join(kind.entry_names())


def _arguments(
    kind: Kind, named: PluginReference, factory: Callable[..., Any], offered: Mapping[str, Any]
) -> dict[str, Any]:
    try:
        parameters = inspect.signature(factory).parameters
    except (TypeError, ValueError):  # a class implemented in C
        parameters = {}
    collecting = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    needed = [
        name
        for name, p in parameters.items()
        if p.default is inspect.Parameter.empty and p.kind not in collecting
    ]
    if len(needed) == len(offered) and not set(needed) & set(offered):
        return dict(zip(needed, offered.values(), strict=True))
    if named.argument and "argument" not in parameters:
        raise InvalidInput(
            f"{kind.name} {named.spec!r} takes no argument, but {named.argument!r} came; leave it "
            "out, or give its constructor a parameter called argument"
        )
    return {name: value for name, value in offered.items() if name in parameters}


def _check_words(kind: Kind, named: PluginReference) -> None:
    if not all(part.isidentifier() for part in (*named.module.split("."), named.attribute)):
        raise InvalidInput(
            f"{kind.name} {named.spec!r} is no package:attribute, such as my_package:Mine"
        )


def _class_of(base: type) -> str:
    return f"a class that derives from {base.__module__}.{base.__name__}"


def _look_here() -> None:
    """Make modules of the current folder importable, as `python -m` does."""
    here = os.getcwd()
    if not {"", here} & set(sys.path):
        sys.path.append(here)
    importlib.invalidate_caches()


def _not_found(kind: Kind, spec: str, module: str) -> str:
    return (
        f"{kind.name} {spec!r} cannot be loaded: there is no package or module {module!r}, neither "
        f"in {os.getcwd()} nor installed; start in its folder, put that on PYTHONPATH, or install "
        f"it{_offered(kind)}"
    )


def _not_imported(kind: Kind, named: PluginReference, error: BaseException) -> str:
    return (
        f"{kind.name} {named.spec!r} cannot be loaded: the import of {named.module} failed "
        f"({_reason(error)}); mend that, or install what it needs"
    )


def _offered(kind: Kind) -> str:
    known = list_names(kind)
    return f" (installed packages offer {known})" if known else ""


def _reason(error: BaseException) -> str:
    """Type and text of an exception; for a syntax error also file and line."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{type(error).__name__} in {error.filename}, line {error.lineno}: {error.msg}"
    return f"{type(error).__name__}: {error}"


def described(value: object) -> str:
    """Phrase that describes a value, for messages."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if inspect.ismodule(value):
        return f"the module {value.__name__}"
    if inspect.isroutine(value):
        return f"the function {value.__name__}"
    return f"of type {type(value).__name__}"
