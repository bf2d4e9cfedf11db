"""Simulate a full disk for the store of a planner."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from helios_planner.service import PlannerService
from helios_planner.tasks.store import Store


def refuse(store: Store, refuses: bool = True) -> None:
    """Make every write to a store fail; with `refuses=False` none."""
    with store._lock:
        store._db.execute(f"PRAGMA query_only={int(refuses)}")


@contextmanager
def refusing(planner: PlannerService) -> Iterator[Store]:
    """Make all writes to a planner's store fail inside the block; yield the store."""
    refuse(planner._store)
    try:
        yield planner._store
    finally:
        refuse(planner._store, refuses=False)
