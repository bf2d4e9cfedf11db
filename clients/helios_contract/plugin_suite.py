"""The suites for detectors and scorers: import them from here, so that asserts say their values."""

from __future__ import annotations

import pytest

pytest.register_assert_rewrite(
    "helios_contract.back_end", "helios_contract.detecting", "helios_contract.scoring"
)

from helios_contract.detecting import DetectorContract  # noqa: E402 - after the line above
from helios_contract.scoring import ScorerContract  # noqa: E402

__all__ = ["DetectorContract", "ScorerContract"]
