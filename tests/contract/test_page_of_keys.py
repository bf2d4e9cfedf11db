"""The page of keys is whole: another language finds every key and its messages there."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_core.topics import METHODS, TOPICS, Method, Topic

PAGE = (Path(__file__).parents[2] / "docs/wire-contract.md").read_text()


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_the_page_names_each_topic_with_its_message_and_quality(topic: Topic) -> None:
    row = f"| `{topic.name}` | `{topic.type.DESCRIPTOR.name}` | `{topic.qos.name}` |"
    assert row in PAGE, f"add to docs/wire-contract.md: {row}"


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_the_page_names_each_method_with_its_messages(method: Method) -> None:
    name = f"truth: {method.name}" if method.truth else method.name
    row = f"| `{name}` | `{method.request.DESCRIPTOR.name}` | `{method.reply.DESCRIPTOR.name}` |"
    assert row in PAGE, f"add to docs/wire-contract.md: {row}"
