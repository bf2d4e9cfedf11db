"""The scorer `transformers:<model id or folder>`: scores of an image against prompts.

The paper uses BLIP-2 (section 3.1.2, after VLFM). Its image-text contrastive head (ITC) gives a
cosine. Its matching head (ITM) gives a probability from image and text together; it has no
embeddings, so no prompt can be scored later. CLIP and SigLIP are smaller models.
Scores are clip(scale * cosine + offset, 0, 1), which keeps the order of the cosines.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from helios_core.embedding_similarity import image_text_score
from helios_core.errors import InvalidInput
from helios_core.types import Embedding, Frame
from numpy.typing import NDArray

from helios_detector.backend import Judgement, ScorerBackend, Seen, TextEmbeddings
from helios_detector.hf.model_runtime import HfModel, Placement, config_of, picture, source_of

SETTING = "scorer"
TEXTS_REMEMBERED = 256
HEADS = ("itc", "itm")


class EmbeddingModel(ABC):
    """Embedding of images and texts as unit vectors by one model family."""

    model_class = "AutoModel"
    scale, offset = 1.0, 0.0  # map from cosine to score

    @abstractmethod
    def image(self, model: Any, inputs: dict[str, Any]) -> Any:
        """Embedding [rows, d] of one image from the processor's pixels."""

    @abstractmethod
    def texts(self, model: Any, inputs: dict[str, Any]) -> Any:
        """Embeddings [texts, d] from the output of `tokens`."""

    def tokens(self, model: Any, processor: Any, texts: list[str]) -> Any:
        """Input of the text model, one row per text; longer texts are truncated."""
        return processor.tokenizer(texts, padding=True, truncation=True, return_tensors="pt")


class Clip(EmbeddingModel):
    """CLIP and models with the same interface."""

    def image(self, model: Any, inputs: dict[str, Any]) -> Any:
        return _unit(_pooled(model.get_image_features(**inputs)))

    def texts(self, model: Any, inputs: dict[str, Any]) -> Any:
        return _unit(_pooled(model.get_text_features(**inputs)))


class Siglip(Clip):
    """SigLIP: texts are padded to one length, as in its training; its cosines lie around 0."""

    scale, offset = 0.5, 0.5

    def tokens(self, model: Any, processor: Any, texts: list[str]) -> Any:
        length = int(model.config.text_config.max_position_embeddings)
        return processor(
            text=texts,
            padding="max_length",
            max_length=length,
            truncation=True,
            return_tensors="pt",
        )


class Blip2(EmbeddingModel):
    """BLIP-2's retrieval model: one vector per query token of the image."""

    model_class = "Blip2ForImageTextRetrieval"

    def image(self, model: Any, inputs: dict[str, Any]) -> Any:
        pixels = self.pixels(model, inputs)
        out = model.qformer(query_embeds=model.query_tokens, encoder_hidden_states=pixels)
        return _unit(_cast(out.last_hidden_state, model.vision_projection))[0]

    def texts(self, model: Any, inputs: dict[str, Any]) -> Any:
        out = model.qformer(
            query_embeds=model.embeddings(input_ids=inputs["input_ids"]),
            query_length=0,
            attention_mask=inputs["attention_mask"],
        )
        return _unit(_cast(out.last_hidden_state[:, 0], model.text_projection))

    def pixels(self, model: Any, inputs: dict[str, Any]) -> Any:
        """Output [1, patches, width] of the image encoder."""
        return model.vision_model(pixel_values=inputs["pixel_values"]).last_hidden_state

    def match(self, model: Any, pixels: Any, tokens: dict[str, Any]) -> Any:
        """Probability [texts] from the ITM head that each text matches the image."""
        import torch

        count = len(tokens["input_ids"])
        queries = model.query_tokens.expand(count, -1, -1)
        ones = torch.ones(queries.shape[:2], dtype=torch.long, device=queries.device)
        out = model.qformer(
            query_embeds=model.embeddings(input_ids=tokens["input_ids"], query_embeds=queries),
            query_length=queries.shape[1],
            attention_mask=torch.cat([ones, tokens["attention_mask"]], 1),
            encoder_hidden_states=pixels.expand(count, -1, -1),
        )
        logits = _cast(out.last_hidden_state[:, : queries.shape[1]], model.itm_head).mean(1)
        return logits.float().softmax(-1)[:, 1]


TOWERS: dict[str, type[EmbeddingModel]] = {
    "blip-2": Blip2,
    "clip": Clip,
    "siglip": Siglip,
    "siglip2": Siglip,
    "metaclip_2": Clip,
    "align": Clip,
    "altclip": Clip,
    "chinese_clip": Clip,
}


class HfScorer(ScorerBackend):
    """Image-text scorer; runs the image model once per frame and caches text embeddings."""

    def __init__(self, spec: str, placement: Placement, head: str = "itc") -> None:
        """Raises Unavailable (library, folder, hub) or InvalidInput (a model of another kind)."""
        if head not in HEADS:
            raise InvalidInput(f"score_head is {head!r}; set one of {', '.join(HEADS)}")
        source = source_of(spec, SETTING)
        kind = config_of(source, SETTING).model_type
        if kind not in TOWERS:
            raise InvalidInput(
                f"{source} is a {kind!r} model, which compares no image with a text; set {SETTING} "
                f"to a model of one of {', '.join(TOWERS)}"
            )
        self._tower = TOWERS[kind]()
        if head == "itm" and not isinstance(self._tower, Blip2):
            raise InvalidInput(
                f"score_head itm is of BLIP-2 alone and {source} is {kind!r}; set score_head to itc"
            )
        self._matches = head == "itm"
        self._model = HfModel(source, SETTING, placement, self._tower.model_class)
        self._texts: OrderedDict[str, NDArray[np.float32]] = OrderedDict()
        self._lock = threading.Lock()  # guards `_texts`
        self.name = f"{spec} ({head})" if kind == "blip-2" else spec

    def warm_up(self) -> None:
        self._judge(np.full((224, 224, 3), 114, np.uint8), ["a cup"])

    def unload(self) -> None:
        self._model.unload()

    def accelerator_mb(self) -> float:
        return self._model.accelerator_mb()

    def close(self) -> None:
        self.unload()

    def score(
        self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]
    ) -> dict[str, float]:
        return self.judge(frame, seen, prompts).scores

    def judge(self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]) -> Judgement:
        if not prompts:
            return Judgement({})
        image, scores = self._judge(frame.color, list(prompts.values()))
        return Judgement(dict(zip(prompts, scores, strict=True)), image)

    def embed_text(self, prompts: Sequence[str]) -> TextEmbeddings:
        """Embeddings of prompts. Raises InvalidInput for the matching head, which has none."""
        if self._matches:
            raise InvalidInput(
                f"the scorer {self.name} looks at the image and the text together and has no "
                "embeddings; set score_head to itc"
            )
        with self._model.use() as (model, processor):
            vectors = self._text_vectors(model, processor, list(prompts))
        texts = tuple(Embedding(self._model.source, v[None]) for v in vectors)
        return TextEmbeddings(texts, self._tower.scale, self._tower.offset)

    def _judge(
        self, color: NDArray[np.uint8], prompts: list[str]
    ) -> tuple[Embedding | None, list[float]]:
        """(embedding of the image, None with the matching head; score of each prompt)."""
        with self._model.use() as (model, processor):
            inputs = self._model.to_device(
                processor.image_processor(images=picture(color), return_tensors="pt")
            )
            if self._matches and isinstance(self._tower, Blip2):
                pixels = self._tower.pixels(model, inputs)
                tokens = self._tower.tokens(model, processor, prompts)
                match = self._tower.match(model, pixels, self._model.to_device(tokens))
                return None, [float(p) for p in match.cpu()]
            vectors = self._tower.image(model, inputs).float().cpu().numpy()
            texts = self._text_vectors(model, processor, prompts)
        image = Embedding(self._model.source, vectors.reshape(-1, vectors.shape[-1]))
        scale, offset = self._tower.scale, self._tower.offset
        return image, [
            image_text_score(image, Embedding(image.model, t[None]), scale, offset) for t in texts
        ]

    def _text_vectors(
        self, model: Any, processor: Any, texts: list[str]
    ) -> list[NDArray[np.float32]]:
        with self._lock:
            new = [t for t in dict.fromkeys(texts) if t not in self._texts]
        if new:
            tokens = self._tower.tokens(model, processor, new)
            made = self._tower.texts(model, self._model.to_device(tokens)).float().cpu().numpy()
            with self._lock:
                self._texts.update(zip(new, made, strict=True))
        with self._lock:
            for text in texts:
                self._texts.move_to_end(text)
            out = [self._texts[t] for t in texts]
            while len(self._texts) > TEXTS_REMEMBERED:
                self._texts.popitem(last=False)
        return out


def _pooled(output: Any) -> Any:
    return getattr(output, "pooler_output", output)


def _cast(states: Any, layer: Any) -> Any:
    return layer(states.to(layer.weight.dtype))


def _unit(vectors: Any) -> Any:
    return vectors.float() / vectors.float().norm(dim=-1, keepdim=True)
