"""Limit on the requests of each client in a second."""

from __future__ import annotations

from helios_gateway.request_rate import RequestRate
from hypothesis import given
from hypothesis import strategies as st


class Clock:
    now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


@given(
    st.lists(st.tuples(st.sampled_from("ab"), st.floats(0, 1.5)), max_size=60), st.integers(1, 5)
)
def test_no_client_has_more_than_the_limit_in_a_second(
    requests: list[tuple[str, float]], most: int
) -> None:
    clock = Clock()
    rate = RequestRate(most, clock)
    allowed: dict[tuple[str, int], int] = {}
    for client, wait_s in requests:
        clock.now_s += wait_s
        now = client, int(clock.now_s)
        could = allowed.get(now, 0) < most
        assert rate.allows(client) is could
        allowed[now] = allowed.get(now, 0) + could


def test_a_client_that_was_refused_is_allowed_in_the_next_second() -> None:
    clock = Clock()
    rate = RequestRate(1, clock)
    assert [rate.allows("a") for _ in range(3)] == [True, False, False]
    clock.now_s += 1
    assert rate.allows("a")
