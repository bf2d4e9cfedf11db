"""Replies of a method over Zenoh; the bus contract tests the rest (`tests/contract`)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from helios_core.errors import Conflict, HeliosError, Internal, error_to_proto
from helios_core.topics import GET_TASK
from helios_core.zenoh_messages import ERROR_ENCODING, assembled


def refusal(data: bytes) -> Any:
    """The replies to one query: an error with these bytes."""
    payload = SimpleNamespace(to_bytes=lambda: data)
    return [SimpleNamespace(err=SimpleNamespace(payload=payload, encoding=ERROR_ENCODING))]


@pytest.mark.parametrize(
    ("data", "kind", "said"),
    [
        (error_to_proto(Conflict("a stop")).SerializeToString(), Conflict, "a stop"),
        (b"\xff\xff", Internal, "planner/get .* 2 bytes that are no helios.v1.Error; run one ver"),
    ],
)
def test_an_error_reply_raises_a_typed_error_whatever_its_bytes(
    data: bytes, kind: type[HeliosError], said: str
) -> None:
    with pytest.raises(kind, match=said):
        assembled(GET_TASK, refusal(data))
