"""Synthetic episodes for viewing and testing reports. They are not results.

    python tests/unit/eval/synthetic_episodes.py FOLDER

writes a folder as `helios eval` does, with random outcomes and figures for each agent.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from helios_eval.episodes import episode_record, failure_snapshot
from helios_eval.episodes.episode_record import Belief, EpisodeRecord, Noise
from helios_eval.episodes.failure_snapshot import FailureSnapshot, MarkedObject

NOISE = Noise(table="synthetic", digest="0" * 64, level=1.0, correlation=None)
OBJECTS = ("mug", "toy animal", "spray bottle", "book", "sushi mat")
PLACES = ("kitchen counter", "coffee table", "bed", "shelves", "chest of drawers")
CHANCES = {  # of FindObj, Pick, FindRec, Place, no collision: each given the previous
    "helios-paper": (0.86, 0.82, 0.85, 0.80, 0.85),
    "trusting": (0.62, 0.55, 0.80, 0.75, 0.80),
    "no-global-objective": (0.80, 0.75, 0.82, 0.78, 0.84),
    "random-frontier": (0.55, 0.45, 0.70, 0.70, 0.75),
    "ground-truth-walker": (1.0, 0.99, 1.0, 0.99, 0.99),
}
CAUSES = ("object not found", "wrong object believed", "receptacle not found", "place missed")


def episode(seed: int, agent: str = "helios-paper", **changes: Any) -> EpisodeRecord:
    """One random episode; the same arguments give the same episode."""
    names = sorted(CHANCES)
    rng = np.random.default_rng([seed, names.index(agent) if agent in names else len(names)])
    home = np.random.default_rng([seed, 99])  # for all agents
    hard = home.random() * 0.25
    truth = changes.get("semantics") == "ground-truth"
    chances = [min(1.0, c + (0.15 if truth else 0)) for c in CHANCES.get(agent, (0.7,) * 5)]
    met = [bool(rng.random() < c - (hard if i == 0 else 0)) for i, c in enumerate(chances)]
    found, pick, there, place = (all(met[: i + 1]) for i in range(4))
    success = place and met[4]
    failed = next((c for c, m in zip(CAUSES, met, strict=False) if not m), "collision")
    other = ("step budget", "stuck", "object rolled off", "pick failed", "system error")
    if rng.random() < 0.3 and not place:
        failed = str(rng.choice(other, p=[0.4, 0.25, 0.15, 0.17, 0.03]))
    thing, start, goal = home.choice(OBJECTS), *home.choice(PLACES, 2, replace=False)
    steps = int(rng.gamma(6, 50 if success else 110))
    values: dict[str, Any] = {
        "benchmark": "ovmm", "agent": agent, "semantics": "noisy", "preset": "synthetic",
        "seed": seed, "noise": None if truth else NOISE,
        "instruction": f"Move the {thing} from the {start} to the {goal}",
        "object_class": str(thing), "find_object": found, "pick": pick, "find_receptacle": there,
        "place": place, "success": success, "steps": min(steps, 1250),
        "collisions": 0 if met[4] else int(rng.integers(1, 6)),
        "collided_with": () if met[4] else (str(rng.choice(["chair", "bed", "wall"])),),
        "path_m": steps * 0.05, "picks": int(rng.geometric(0.6)) if found else 0,
        "cause": "" if success else failed, "state": "succeeded" if place else "failed",
        "message": "The task is done." if place else f"Nothing left to look at for the {thing}.",
        "wall_s": steps * 0.06, "step_ms": float(rng.normal(62, 9)),
        "stage_ms": {k: float(rng.gamma(9, v / 9)) for k, v in STAGES.items()},
        "beliefs": tuple(_beliefs(rng, steps)) if agent == "helios-paper" else (),
        "commit": "0000000-dirty", "preset_hash": "1" * 64, "structure_hash": f"{seed:064d}",
    }  # fmt: skip
    return EpisodeRecord(**(values | changes))


STAGES = {
    "render camera": 21.0,
    "object map": 14.0,
    "detect": 6.0,
    "map 2d": 9.0,
    "plan": 5.0,
    "gaze points": 3.0,
}


def _beliefs(rng: np.random.Generator, steps: int) -> list[Belief]:
    out = []
    for instance in range(12):
        right = bool(rng.random() < 0.6)
        score = float(np.clip(rng.normal(0.62 if right else 0.4, 0.15), 0, 1))
        unsure = float(rng.beta(2, 8))
        out.append(
            Belief(
                step=steps,
                instance=instance,
                role=("object", "start", "goal")[instance % 3],
                class_name="synthetic",
                class_score=score,
                score=score - unsure * 0.3,
                uncertainty=unsure,
                views=int(rng.integers(1, 12)),
                gaussians=200,
                correct=right,
            )
        )
    return out


def kept(episode: EpisodeRecord) -> FailureSnapshot:
    """A random failure snapshot for a failed episode."""
    rng = np.random.default_rng(episode.seed)
    cell_m, size = 0.05, 220
    grid = np.full((size, size), -1, np.int8)
    for x, y in ((15, 20), (80, 20), (15, 95), (90, 100)):
        w, h = rng.integers(55, 80, 2)
        grid[y : y + h, x : x + w] = 100
        grid[y + 2 : y + h - 2, x + 2 : x + w - 2] = 0
        for _ in range(3):
            bx, by = x + rng.integers(5, w - 18), y + rng.integers(5, h - 12)
            grid[by : by + 8, bx : bx + 14] = 100
    grid[50:56, 60:100], grid[70:110, 40:46], grid[120:126, 60:100] = 0, 0, 0
    walk = np.cumsum(rng.normal(0, 0.12, (150, 2)), axis=0)
    path = np.array([2.0, 2.2]) + np.linspace(0, 1, 150)[:, None] * [4.0, 3.8] + walk * 0.4
    camera = rng.integers(60, 200, (12, 9, 3), dtype=np.uint8)
    camera = cv2.resize(camera, (120, 160), interpolation=cv2.INTER_CUBIC)
    return FailureSnapshot(
        key=episode.key, agent=episode.agent, semantics=episode.semantics, seed=episode.seed,
        instruction=episode.instruction, cause=episode.cause, message=episode.message,
        occupancy=grid, origin_m=(0.0, 0.0), cell_m=cell_m,
        trajectory_m=path, start_pose=(2.0, 2.2, 0.6),
        candidates=(MarkedObject(episode.object_class, (6.2, 5.9, 0.8), (0.1, 0.1, 0.1)),),
        goals=(MarkedObject("bed", (2.5, 6.5, 0.3), (1.9, 1.2, 0.6)),),
        beliefs=(
            MarkedObject(episode.object_class, (5.4, 2.4, 0.8), (0.2, 0.2, 0.2), 0.58, 0.66),
            MarkedObject("bed", (2.6, 6.4, 0.4), (1.6, 1.1, 0.4), 0.71, 0.8),
        ),
        camera_jpeg=cv2.imencode(".jpg", camera)[1].tobytes(),
    )  # fmt: skip


def write(folder: Path, episodes: list[EpisodeRecord], pictures: bool = True) -> None:
    """Write a folder as the runner does."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = "".join(e.model_dump_json() + "\n" for e in episodes)
    (folder / episode_record.EPISODES).write_text(lines, encoding="utf-8")
    for e in episodes if pictures else []:
        if e.cause:
            failure_snapshot.save(folder, kept(e))


def main(folder: Path) -> None:
    """Write a folder with everything that a report can show."""
    from helios_eval.report import write_report

    episodes = [episode(s, a) for a in CHANCES for s in range(60)]
    episodes += [
        episode(s, a, semantics="ground-truth")
        for a in ("helios-paper", "trusting")
        for s in range(60)
    ]
    write(folder, episodes)
    run = {
        "command": "helios eval ovmm --agents helios-paper (SYNTHETIC: nothing was run)",
        "machine": "no machine: synthetic",
        "started": "never",
        "wall_s": 0.0,
    }
    (folder / "run.json").write_text(json.dumps(run))
    write_report(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
