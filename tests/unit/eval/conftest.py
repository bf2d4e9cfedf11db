"""Makes the helper modules in this folder importable, and keeps tests out of the real ledger."""

import sys
from pathlib import Path

import pytest
from helios_eval import ledger
from helios_eval.runs import evaluation_run

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(autouse=True)
def own_ledger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Path of this test's ledger. The code counts as that of a commit without changes."""
    path = tmp_path / "a-checkout" / ledger.LEDGER
    monkeypatch.setattr(ledger, "ledger_path", lambda: path)
    monkeypatch.setattr(evaluation_run, "commit", lambda: "c")
    return path
