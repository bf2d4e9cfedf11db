"""Configurations of Zenoh sessions: one router, with every service as its client."""

from __future__ import annotations

import json

import zenoh

LEASE_MS = 2000  # a peer without a sign of life is dropped after this time


def client_config(router: str) -> zenoh.Config:
    """Configuration of a client of one router, e.g. `tcp/127.0.0.1:7447`."""
    return _config({"mode": "client", "connect": {
        "endpoints": [router], "timeout_ms": 1000, "exit_on_failure": True,
        "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
    }})  # fmt: skip


def router_config(listen: str) -> zenoh.Config:
    """Configuration of the router, listening on `listen` only."""
    return _config({"mode": "router", "listen": {"endpoints": [listen], "exit_on_failure": True}})


def _config(specific: dict) -> zenoh.Config:
    common = {
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},  # needed by retained topics
        "transport": {"link": {"tx": {"lease": LEASE_MS}}},
    }
    return zenoh.Config.from_json5(json.dumps(common | specific))
