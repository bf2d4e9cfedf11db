"""Constructs episode records with beliefs of known calibration."""

import numpy as np
from helios_eval.episodes.episode_record import Belief, EpisodeRecord, Noise
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.episodes.home_presets import digest_of


def belief(instance: int, correct: bool, class_score: float = 0.6, **figures) -> Belief:
    chosen = {
        "step": 10,
        "role": "object",
        "class_name": "mug",
        "score": class_score - 0.1,
        "uncertainty": 0.1,
        "views": 3,
        "gaussians": 50,
    }
    return Belief.model_validate(
        {**chosen, **figures, "instance": instance, "correct": correct, "class_score": class_score}
    )


def record(seed: int, beliefs: tuple[Belief, ...] = (), **chosen) -> EpisodeRecord:
    facts = {
        "benchmark": "ovmm", "agent": "helios-paper", "semantics": "noisy", "preset": "ovmm-v1",
        "seed": seed, "noise": Noise(table="ovmm-v1", digest="0", level=1.0, correlation=None),
        "instruction": "Move the mug from the table to the sofa", "object_class": "mug",
        "find_object": True, "pick": True, "find_receptacle": True, "place": True, "success": True,
        "collisions": 0, "steps": 100, "path_m": 10.0, "picks": 1, "cause": "",
        "state": "succeeded", "message": "", "wall_s": 1.0, "step_ms": 10.0, "commit": "c",
        "preset_hash": digest_of("ovmm-v1"), "structure_hash": "s",
    }  # fmt: skip
    return EpisodeRecord.model_validate({**facts, **chosen, "beliefs": beliefs})


def record_of(spec: EpisodeSpec, **chosen) -> EpisodeRecord:
    """A successful record with the key of a specification."""
    facts = {
        "benchmark": spec.benchmark, "agent": spec.agent, "semantics": spec.semantics,
        "preset": spec.preset, "noise": spec.noise, "settings": spec.settings,
    }  # fmt: skip
    return record(spec.seed, **facts | chosen)


def episodes(
    count: int, overconfident: float = 0.0, first_seed: int = 0, **chosen
) -> list[EpisodeRecord]:
    """Episodes of 12 instances each; the truth is drawn with probability S - overconfident."""
    rng = np.random.default_rng(first_seed + 1)
    out = []
    for seed in range(first_seed, first_seed + count):
        luck = rng.normal(0, 0.08)  # shared by the instances of one home
        found = []
        for instance in range(1, 13):
            views = int(np.ceil(rng.gamma(1.5, 3.0)))
            s = float(np.clip(rng.beta(2, 1.2), 0.02, 0.98))
            u = float(np.sqrt(s * (1 - s) / (views + 2)))
            right = bool(rng.random() < np.clip(s - overconfident + luck, 0, 1))
            found.append(
                belief(
                    instance,
                    right,
                    s,
                    score=s - u,
                    uncertainty=u,
                    views=views,
                    role="object" if instance % 2 else "goal",
                )
            )
        out.append(record(seed, tuple(found), **chosen))
    return out
