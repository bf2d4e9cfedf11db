"""Smaller copies of recorded histories, for the regression tests of the object map.

    python -m helios_eval.studies.small_histories runs/histories/helios-312.history.gz \
        --out tests/unit/objectmap/histories --step 8 --observations 60-120

A copy has every `--step`-th pixel of the images in both directions, no colours, and only some of
the observations. `map_histories replay` takes it like any other, with `--set stride_px=1`.
"""

from __future__ import annotations

import argparse
import gzip
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.codec import observation_from_proto, observation_to_proto
from helios_core.errors import HeliosError
from helios_core.geometry import Pinhole
from helios_core.types import Detection, Observation

from helios_eval.studies.development_homes import seeds
from helios_eval.studies.map_histories import Event, Truth, events_of, packed

_KINDS: dict[type[Message], bytes] = {
    pb.SearchContext: b"C",
    pb.Observation: b"O",
    pb.RobotState: b"S",
}


def thinned(observation: Observation, step: int) -> Observation:
    """Observation with every `step`-th pixel of its images, from pixel step // 2 on, and without
    colours. Detections that have none of these pixels are left out."""
    frame, first = observation.frame, step // 2
    c = frame.camera
    depth_m = np.ascontiguousarray(frame.depth_m[first::step, first::step])
    height, width = depth_m.shape
    camera = Pinhole(
        c.fx / step, c.fy / step, (c.cx - first) / step, (c.cy - first) / step, width, height
    )
    color = np.zeros((height, width, 3), np.uint8)
    return replace(
        observation,
        frame=replace(frame, color=color, depth_m=depth_m, camera=camera),
        detections=tuple(_thinned(observation.detections, step)),
        others=tuple(_thinned(observation.others, step)),
        image_embedding=None,
    )


def _thinned(detections: Iterable[Detection], step: int) -> Iterator[Detection]:
    for d in detections:
        mask = d.mask[step // 2 :: step, step // 2 :: step]
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        if len(rows):
            box = (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
            yield replace(d, box_xyxy=box, mask=mask)


def smaller(events: Iterable[Event], step: int, observations: Sequence[int]) -> Iterator[Event]:
    """The events of a history with the numbered observations (from 0 on) alone."""
    kept, seen = set(observations), -1
    for event in events:
        if isinstance(event, pb.Observation):
            seen += 1
            if seen in kept:
                yield observation_to_proto(thinned(observation_from_proto(event), step))
        elif not isinstance(event, Truth) or seen in kept:
            yield event


def written(events: Iterable[Event]) -> bytes:
    """Content of the file of a history."""
    parts = []
    for event in events:
        if isinstance(event, Truth):
            things = [list(asdict(thing).values()) for thing in event.things]
            text = json.dumps({"things": things, "roles": dict(event.roles)})
            parts.append(packed(b"T", text.encode()))
        else:
            parts.append(packed(_KINDS[type(event)], event.SerializeToString()))
    return gzip.compress(b"".join(parts), 9)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.small_histories",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("histories", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True, help="folder for the copies")
    parser.add_argument("--step", type=int, default=8, help="pixels from one to the next")
    parser.add_argument(
        "--observations", type=seeds, default=range(150), help="the kept ones, as 0-149"
    )
    given = parser.parse_args(argv)
    try:
        given.out.mkdir(parents=True, exist_ok=True)
        for path in given.histories:
            data = written(smaller(events_of(path), given.step, given.observations))
            write_file(given.out / path.name, data)
            print(f"{given.out / path.name}: {len(data) / 1e3:.0f} kB")
    except (HeliosError, OSError) as error:
        print(f"small_histories: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
