"""Class names of an ONNX detector: from a text file beside it, from its metadata, or COCO's 80."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from pathlib import Path

from helios_core.errors import InvalidInput
from helios_core.name_rules import plain

from helios_detector.coco_classes import COCO_NAMES

KEY = "names"  # metadata key that exporters use: {0: 'person', 1: 'bicycle', …} or a list


def class_names(path: Path, metadata: Mapping[str, str], count: int) -> tuple[str, ...]:
    """`count` names in the order of the model's outputs. Raises InvalidInput."""
    beside = path.with_suffix(".txt")
    if beside.is_file():
        try:
            lines = beside.read_text().splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise InvalidInput(f"{beside} cannot be read ({error}); write a name a line") from error
        return _checked([line for line in lines if line.strip()], count, str(beside))
    if KEY in metadata:
        return _checked(_parsed(metadata[KEY], path), count, f"{path} (its metadata {KEY!r})")
    if count == len(COCO_NAMES):
        return COCO_NAMES
    raise InvalidInput(
        f"{path} knows {count} classes and not what they are called; write their names into "
        f"{beside}, one a line in the model's order"
    )


def _parsed(text: str, path: Path) -> list[str]:
    try:
        value = ast.literal_eval(text)
        if isinstance(value, Mapping):
            return [str(value[i]) for i in sorted(value, key=int)]
        if isinstance(value, (list, tuple)):
            return [str(name) for name in value]
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        pass  # the InvalidInput below covers it
    raise InvalidInput(
        f"the metadata {KEY!r} of {path} is {text[:60]!r}; write the names into "
        f"{path.with_suffix('.txt')}, one a line in the model's order"
    )


def _checked(names: Sequence[str], count: int, where: str) -> tuple[str, ...]:
    out = tuple(plain(name) for name in names)
    twice = next((name for i, name in enumerate(out) if name in out[:i]), None)
    if len(out) == count and twice is None:
        return out
    wrong = f"holds {len(out)} names" if len(out) != count else f"holds {twice!r} twice"
    raise InvalidInput(f"{where} {wrong}; the model has {count} classes, one name for each")
