"""Write the table of catalogue numbers and names that `helios_sim.plans` reads.

`python -m scripts.generate_catalogue_names PROGRAM.deb FURNITURE.deb` takes Debian's packages
`sweethome3d` and `sweethome3d-furniture` (apt-get download sweethome3d sweethome3d-furniture). The
English name of an entry gives its class; its names in all languages of the catalogues follow.
"""

from __future__ import annotations

import argparse
import io
import json
import re
import sys
import tarfile
import zipfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

from helios_core.atomic_file import write_file
from helios_sim.assets.sweethome_library import _data_member
from helios_sim.plans.furniture_classes import known_words, plain_name, word_class

OUT = Path(__file__).parents[1] / "clients/helios_sim/plans/catalogue_names.json"
_PROPERTY = re.compile(r"\s*(\w+)#(\d+)\s*=\s*(.*)")
_ESCAPE = re.compile(r"\\u([0-9a-fA-F]{4})")
_CATALOGUE = re.compile(
    r"(?:.*/)?(?:Default|Plugin)FurnitureCatalog(?:_([A-Za-z]{2}(?:_[A-Z]{2})?))?\.properties"
)
# Entries whose English word stands for something else in a home, or is used in another sense.
_CLASSES = {
    "eTeks#chest": "dresser",
    "eTeks#tvUnit": "television",
    "eTeks#sink": "kitchen counter",
    "eTeks#serviceHatch": "window",
    "eTeks#texturableBox": "",
    "eTeks#texturableCylinder": "",
    "eTeks#texturableTriangle": "",
    "eTeks#railing": "",
    "eTeks#glassDoorCabinet": "cabinet",
    "eTeks#electricRadiator": "radiator",
}
_OUTDOORS = ("Exterior", "Vehicles", "Characters")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("packages", nargs="+", type=Path, help="Debian packages")
    args = parser.parse_args()
    ids: dict[str, str] = {}
    said: defaultdict[str, Counter[str]] = defaultdict(Counter)
    languages: set[str] = set()
    for archive in (a for package in args.packages for a in _archives(package)):
        tables = {
            match[1] or "en": _entries(archive.read(n).decode("latin-1"))
            for n in archive.namelist()
            if (match := _CATALOGUE.fullmatch(n))
        }
        languages |= tables.keys()
        for number, entry in tables.get("en", {}).items():
            key = entry.get("id", "")
            name = _class_of(key, entry)
            if name:
                ids[key] = name
            for table in tables.values():
                if local := plain_name(table.get(number, {}).get("name", "")):
                    said[local][name] += 1
    names = {local: counts.most_common(1)[0][0] for local, counts in said.items()}
    # Names whose words give the same class need no row, and our own words come first.
    ours = {word for words in known_words().values() for word in words}
    names = {
        local: name
        for local, name in names.items()
        if name != word_class(local) and local not in ours
    }
    table = {
        "origin": "numbers and names in the furniture catalogues of Sweet Home 3D, by our class; "
        "written by scripts/generate_catalogue_names.py",
        "languages": sorted(languages),
        "ids": _grouped(ids),
        "names": _grouped(names),
    }
    write_file(OUT, (json.dumps(table, ensure_ascii=False, indent=0) + "\n").encode())
    print(f"{OUT}: {len(ids)} numbers, {len(names)} names, {len(languages)} languages")
    return 0


def _class_of(key: str, entry: dict[str, str]) -> str:
    if key in _CLASSES:
        return _CLASSES[key]
    name = entry.get("name", "")
    if entry.get("category", "") in _OUTDOORS and word_class(name) not in ("bench", "chair"):
        return ""
    if entry.get("doorOrWindow") == "true" and word_class(name) not in ("door", "window"):
        return "door" if float(entry.get("elevation", 0)) < 20 else "window"
    return word_class(name)


def _entries(text: str) -> dict[str, dict[str, str]]:
    text = _ESCAPE.sub(lambda match: chr(int(match[1], 16)), text)
    found: dict[str, dict[str, str]] = {}
    for line in text.splitlines():
        if match := _PROPERTY.match(line):
            found.setdefault(match[2], {})[match[1]] = match[3].strip()
    return found


def _archives(package: Path) -> Iterator[zipfile.ZipFile]:
    with package.open("rb") as file, tarfile.open(fileobj=_data_member(file)) as tar:
        for member in tar:
            if member.isfile() and member.name.endswith((".sh3f", "sweethome3d.jar")):
                content = tar.extractfile(member)
                assert content is not None
                yield zipfile.ZipFile(io.BytesIO(content.read()))


def _grouped(class_by: dict[str, str]) -> dict[str, list[str]]:
    groups: defaultdict[str, list[str]] = defaultdict(list)
    for key, name in sorted(class_by.items()):
        groups[name].append(key)
    return dict(sorted(groups.items()))


if __name__ == "__main__":
    sys.exit(main())
