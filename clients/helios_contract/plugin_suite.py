"""Suites for detectors and scorers: import them from here, so that asserts show their values."""

from __future__ import annotations

import pytest

pytest.register_assert_rewrite(
    "helios_contract.model_claims",
    "helios_contract.detector_claims",
    "helios_contract.scorer_claims",
)

from helios_contract.detector_claims import DetectorContract  # noqa: E402 - after the line above
from helios_contract.scorer_claims import ScorerContract  # noqa: E402

__all__ = ["DetectorContract", "ScorerContract"]
