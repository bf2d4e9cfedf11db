"""A disk that takes nothing, for the store of a planner."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from helios_planner.service import PlannerService
from helios_planner.tasks.store import Store


def refuse(store: Store, refuses: bool = True) -> None:
    """Let every write to a store fail, or none any more."""
    with store._lock:
        store._db.execute(f"PRAGMA query_only={int(refuses)}")


@contextmanager
def refusing(planner: PlannerService) -> Iterator[Store]:
    """The store of a planner, whose disk takes nothing meanwhile."""
    refuse(planner._store)
    try:
        yield planner._store
    finally:
        refuse(planner._store, refuses=False)
