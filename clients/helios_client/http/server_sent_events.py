"""Parser of server-sent events."""

from __future__ import annotations

import json

from helios_client.answer_types import Event


class EventParser:
    """Parser that is fed line by line. It skips comments and data that is not a JSON object."""

    def __init__(self) -> None:
        self._fields: dict[str, str] = {}

    def feed(self, line: str) -> Event | None:
        """Event that this line completes, or None."""
        if line:
            name, _, value = line.partition(":")
            if name:
                value = value.removeprefix(" ")
                joined = name == "data" and "data" in self._fields
                self._fields[name] = f"{self._fields['data']}\n{value}" if joined else value
            return None
        fields, self._fields = self._fields, {}
        try:
            data = json.loads(fields.get("data", ""))
        except ValueError:
            return None
        if not isinstance(data, dict):
            return None
        return Event(fields.get("event", "message"), data, fields.get("id", ""))
