"""Client side of the HTTP interface, for both SDKs: requests, responses, errors, events."""
