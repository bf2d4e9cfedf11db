"""The HTTP interface as both SDKs ask it: calls, answers, errors, events."""
