"""Times at which maps are polled."""

from __future__ import annotations

from helios_core.viewing.poll_times import LONGEST_PAUSE_S, PollTimes


def poll(times: PollTimes, name: str, replied: bool, now_s: float) -> None:
    times.begin(name)
    times.end(name, replied, now_s)


def test_only_a_map_with_news_is_polled() -> None:
    times = PollTimes({"map2d": 1.0, "objectmap": 1.0})
    assert times.next() is None
    times.note_news("map2d")
    due = times.next()
    assert due is not None
    assert due[0] == "map2d"
    poll(times, "map2d", True, 10.0)
    assert times.next() is None


def test_a_map_with_news_is_due_one_period_after_its_last_poll() -> None:
    times = PollTimes({"map2d": 1.0, "gaussians": 5.0})
    for name, at_s in (("map2d", 11.0), ("gaussians", 15.0)):
        poll(times, name, True, 10.0)
        times.note_news(name)
        assert times.next() == (name, at_s)
        times.begin(name)


def test_news_that_come_during_a_poll_make_the_map_due_again() -> None:
    times = PollTimes({"map2d": 1.0})
    times.note_news("map2d")
    times.begin("map2d")
    times.note_news("map2d")
    times.end("map2d", True, 10.0)
    assert times.next() == ("map2d", 11.0)


def test_a_map_that_does_not_reply_delays_only_its_own_polls() -> None:
    times = PollTimes({"map2d": 1.0, "objectmap": 1.0})
    for _ in range(9):
        poll(times, "map2d", False, 10.0)
    poll(times, "objectmap", True, 10.0)
    times.note_news("map2d")
    times.note_news("objectmap")
    assert times.next() == ("objectmap", 11.0)
    poll(times, "objectmap", True, 11.5)
    assert times.next() == ("map2d", 10.0 + LONGEST_PAUSE_S)


def test_the_pauses_of_a_map_double_until_it_replies() -> None:
    times = PollTimes({"map2d": 1.0})
    times.note_news("map2d")
    for pause_s in (2.0, 4.0, 8.0, 16.0, LONGEST_PAUSE_S, LONGEST_PAUSE_S):
        times.end("map2d", False, 100.0)
        assert times.next() == ("map2d", 100.0 + pause_s)
    times.end("map2d", True, 100.0)
    assert times.next() == ("map2d", 101.0)


def test_a_map_is_never_polled_more_often_than_its_period() -> None:
    times = PollTimes({"map2d": 3 * LONGEST_PAUSE_S})
    times.note_news("map2d")
    times.end("map2d", False, 0.0)
    assert times.next() == ("map2d", 3 * LONGEST_PAUSE_S)
