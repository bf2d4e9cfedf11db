"""Search of stored views by prompt, with text embeddings from the detector."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable, Sequence

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import Conflict, HeliosError, InvalidInput, Unavailable
from helios_core.topics import EMBED_TEXT
from helios_core.types import SearchContext

from helios_map2d.epoch_map import EpochMap
from helios_map2d.epochs import EpochMaps
from helios_map2d.map_queries import EMPTY_MAP
from helios_map2d.pictures.map_picture import OCCUPANCY
from helios_map2d.view_memory.ranking import (
    Question,
    as_layer,
    best_places,
    by_name,
    located,
    place_message,
    questions,
    scored,
)
from helios_map2d.view_memory.stored_views import SeenView

log = logging.getLogger(__name__)

EMBED_WITHIN_S = 10.0
DEFAULT_PLACES, MOST_PLACES = 5, 50
MOST_LATE_LAYERS = 8  # limit of requested layers per search: each uses memory over the whole grid
LAYER_NAME = re.compile(r"[A-Za-z0-9_.-]{1,40}")  # safe in URLs and file names


class ViewMemoryService:
    """Handler of recall queries: it gets text embeddings from the detector and scores the views.

    It never holds the lock of the maps during a call to the detector.
    """

    def __init__(
        self,
        bus: Bus,
        lock: threading.RLock,
        maps: Callable[[], EpochMaps | None],
        search: Callable[[], pb.SearchContext | None],
    ) -> None:
        """search: the current search context; recall queries cannot write its layers."""
        self._bus, self._lock, self._maps, self._search = bus, lock, maps, search

    def recall(self, request: pb.RecallRequest) -> pb.RecallReply:
        """Places where a prompt was seen; also makes its value layer if the request names one.

        The scorer's image-text model scores the views. Without it the views are searched by
        detected classes, and the reply's note gives the reason. A layer needs the model. Raises
        Unavailable if no view is stored, InvalidInput for an empty prompt, an invalid layer name,
        or too many layers.
        """
        if not request.prompt.strip():
            raise InvalidInput("an empty prompt was asked; send what is looked for")
        if request.layer:
            self._check_name(request.layer)
        state, views = self._views()
        if request.layer:
            self._check_room(state, request.layer)
        if not views:
            raise Unavailable(
                "no view has been kept in this map: no search has looked around in it yet, or the "
                "detector's scorer does not embed images and nothing that is sought was detected; "
                "let the robot search, or start the detector with a scorer that does"
            )
        version, note = state.published.version, ""
        try:
            question = self._question(views, request.prompt)
        except HeliosError as error:
            if request.layer:
                raise type(error)(
                    f"no value layer can be made of {request.prompt[:80]!r}: {error.message}"
                ) from error
            answers, asked = by_name(views, request.prompt), sum(bool(v.named) for v in views)
            note = f"past views were asked by the detector's names alone: {error.message}"
        else:
            fits = scored(views, question)
            answers, asked = located(fits), len(fits)
            if request.layer:
                version = self._put(state, {request.layer: question})
        most = min(request.most_places or DEFAULT_PLACES, MOST_PLACES)
        places = [place_message(answer) for answer in best_places(answers, most)]
        return pb.RecallReply(places=places, views=asked, version=version, note=note)

    def fill(self, context: SearchContext) -> None:
        """Fill the layers of a search from stored views; do nothing if they cannot be scored."""
        try:
            state, views = self._views()
            if not context.prompts or all(v.embedding is None for v in views):
                return
            asked = self._questions(list(context.prompts.values()))
            self._put(state, dict(zip(context.prompts, asked, strict=True)), context.id)
        except HeliosError as error:
            log.info("search %.60s begins without the past: %s", context.id, error.message)

    def _check_name(self, layer: str) -> None:
        """Raise InvalidInput for an invalid or reserved layer name."""
        if not LAYER_NAME.fullmatch(layer):
            raise InvalidInput(
                f"no value layer can be called {layer[:80]!r}: send up to 40 letters, digits, "
                "'.', '_' or '-'"
            )
        search = self._search()
        if layer == OCCUPANCY or (search is not None and layer in search.prompts):
            whose = "the ground's" if layer == OCCUPANCY else "the present search's"
            raise InvalidInput(f"the name {layer!r} is {whose}; give the layer another one")

    def _check_room(self, state: EpochMap, layer: str) -> None:
        """Raise InvalidInput for a layer beyond the limit of requested layers."""
        search = self._search()
        own = set() if search is None else set(search.prompts)
        late = sorted(set(state.published.layers) - own)
        if layer not in late and len(late) >= MOST_LATE_LAYERS:
            raise InvalidInput(
                f"{len(late)} layers were asked for in this search already ({', '.join(late)}): "
                "send the name of one of them, which is then made again, or begin another search"
            )

    def _views(self) -> tuple[EpochMap, tuple[SeenView, ...]]:
        with self._lock:
            maps = self._maps()
            if maps is None or maps.current is None:
                raise Unavailable(EMPTY_MAP)
            return maps.current, maps.current.memory.snapshot()

    def _question(self, views: Sequence[SeenView], prompt: str) -> Question:
        """Prompt with its embedding. Raises Unavailable if no view was embedded by the scorer's
        present model, and the errors of the detector."""
        if all(view.embedding is None for view in views):
            raise Unavailable(
                "the detector's scorer does not embed images "
                "(docs/how-to/models.md tells which ones do)"
            )
        (question,) = self._questions([prompt])
        models = sorted({v.embedding.model for v in views if v.embedding is not None})
        if question.text.model not in models:
            raise Unavailable(
                f"past views were seen by the model {', '.join(models)}, the detector's scorer is "
                f"{question.text.model} now: start it with the former, or let the robot look again"
            )
        return question

    def _questions(self, prompts: Sequence[str]) -> list[Question]:
        request = pb.EmbedTextRequest(prompts=prompts)
        return questions(prompts, self._bus.call(EMBED_TEXT, request, EMBED_WITHIN_S))

    def _put(
        self, state: EpochMap, layers: dict[str, Question], context_id: str | None = None
    ) -> int:
        """Set layers from all views stored now and return the map version that has them."""
        with self._lock:
            maps = self._maps()
            if maps is None or maps.current is not state:
                raise Conflict("the map was replaced meanwhile; ask again")
            if context_id is not None and state.context_id != context_id:
                raise Conflict("another search has begun meanwhile")
            for name, question in layers.items():
                fits = scored(state.memory.snapshot(), question)
                state.set_layer(name, as_layer(fits))
            return state.published.version
