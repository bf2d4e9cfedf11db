"""Common contract tests of detectors and scorers, and the construction of the tested back end."""

from __future__ import annotations

from typing import Any, ClassVar, Generic, TypeVar

import pytest

from helios_contract.bench import Bench

T = TypeVar("T", bound=Bench[Any])


class BackEndContract(Generic[T]):
    """Common contract tests of back ends.

    Subclass a suite under a name that begins with Test, and construct the back end in `stand`.
    """

    _bench: ClassVar[Any]

    @classmethod
    def stand(cls) -> T:
        """Test bench with the back end."""
        raise NotImplementedError("say how it is made: def stand(cls), which returns a bench")

    @classmethod
    def setup_class(cls) -> None:
        cls._bench = cls.stand()

    @classmethod
    def teardown_class(cls) -> None:
        cls._bench.close()

    @pytest.fixture
    def bench(self) -> T:
        return self._bench

    def test_it_has_a_name(self, bench: T) -> None:
        assert isinstance(bench.back_end.name, str)
        assert bench.back_end.name.strip()

    def test_it_tells_the_accelerators_memory_as_a_number(self, bench: T) -> None:
        assert bench.back_end.accelerator_mb() >= 0

    def test_closing_twice_is_as_once(self, bench: T) -> None:
        made = bench.make()
        made.close()
        made.close()
