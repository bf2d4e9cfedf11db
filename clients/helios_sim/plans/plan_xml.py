"""Safe reader of `Home.xml`: no document type, no entities, limited depth and size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from helios_core.errors import InvalidInput

MOST_ELEMENTS = 400_000
MOST_DEPTH = 40


@dataclass
class Element:
    """Element with its attributes and children; text is not kept."""

    tag: str
    attributes: Mapping[str, str]
    children: list[Element] = field(default_factory=list)

    def all(self, *tags: str) -> list[Element]:
        """Children with one of these tags, in order."""
        return [child for child in self.children if child.tag in tags]


def parse(data: bytes, name: str) -> Element:
    """Root element. name: file name for messages. Raises InvalidInput for anything but plain XML.

    Sweet Home 3D writes no document type, so a file with one is refused.
    """
    root = Element("", {})
    open_elements, count = [root], 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > MOST_ELEMENTS or len(open_elements) > MOST_DEPTH:
            raise InvalidInput(
                f"Home.xml in {name} has more than {MOST_ELEMENTS} elements or {MOST_DEPTH} "
                "levels, as no home does; save the home again in Sweet Home 3D"
            )
        element = Element(tag, attributes)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        open_elements.pop()

    def refuse(*_: object) -> None:
        raise InvalidInput(
            f"Home.xml in {name} declares a document type or entities, which Sweet Home 3D never "
            "writes and HELIOS does not read; save the home again in Sweet Home 3D"
        )

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.UnparsedEntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise InvalidInput(
            f"Home.xml in {name} is no valid XML ({error}); save the home again in Sweet Home 3D"
        ) from error
    if not root.children or root.children[0].tag != "home":
        raise InvalidInput(
            f"Home.xml in {name} describes no home; save the home again in Sweet Home 3D"
        )
    return root.children[0]
