"""The rules by which several detectors share several robots, in every order of events."""

from helios_core import proto as pb
from helios_detector.robot_assignment import (
    MOST_REMEMBERED,
    SETTLE_S,
    AssignmentTable,
    Members,
    key_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st

ROBOTS = ("ada", "bob", "cleo", "dan")


def member(name: str, *others: str, now_s: float = 0.0) -> Members:
    """One detector that knows these others."""
    out = Members(name, ROBOTS)
    for other in (name, *others):
        out.change(f"{out.team}-{other}", True, now_s)
    return out


def frame(seq: int) -> pb.Frame:
    return pb.Frame(id=pb.FrameId(robot_boot_id="r", world_epoch=0, seq=seq))


def claim(seq: int, instance: str, answered: bool = False) -> pb.Claim:
    return pb.Claim(id=frame(seq).id, instance=instance, answered=answered)


@settings(deadline=None)
@given(names=st.sets(st.text("abcdef", min_size=1, max_size=4), min_size=1, max_size=5))
def test_each_robot_has_one_detector_and_loads_differ_by_at_most_one(names: set[str]):
    everybody = [member(n, *names) for n in names]
    later_s = 2 * SETTLE_S
    takers = {r: [m.me for m in everybody if m.takes(r, later_s)] for r in ROBOTS}
    assert all(len(t) == 1 for t in takers.values())
    work = [sum(t == [m.me] for t in takers.values()) for m in everybody]
    assert max(work) - min(work) <= 1


def test_no_robot_is_taken_during_the_settle_time_after_a_detector_joins_or_leaves():
    one, other = member("a"), Members("b", ROBOTS)
    assert one.takes("ada", 1.0)
    one.change(other.me, True, 1.0)
    assert not any(one.takes(r, 1.0 + 0.9 * SETTLE_S) for r in ROBOTS)
    assert sum(one.takes(r, 1.0 + SETTLE_S) for r in ROBOTS) == 2
    one.change(other.me, False, 5.0)
    assert not one.takes("ada", 5.0)
    assert all(one.takes(r, 5.0 + SETTLE_S) for r in ROBOTS)


def test_a_detector_with_another_robot_list_is_flagged_and_shares_no_robots():
    one, stranger = member("a"), Members("b", ("ada",))
    one.change(stranger.me, True, 0.0)
    assert one.has_other_lists
    assert all(one.takes(r, 1.0) for r in ROBOTS)
    one.change(stranger.me, False, 1.0)
    assert not one.has_other_lists


def test_keyframes_are_taken_oldest_first_and_once():
    ledger, there = AssignmentTable(), frozenset({"a", "b"})
    for seq in (1, 2, 2, 3):
        ledger.add(frame(seq))
    taken = []
    while (message := ledger.next(there)) is not None:
        taken.append(message.id.seq)
        ledger.note(claim(message.id.seq, "a"))
    assert taken == [1, 2, 3]


def test_an_unanswered_keyframe_is_free_again_when_its_detector_is_gone():
    ledger = AssignmentTable()
    ledger.add(frame(1))
    ledger.add(frame(2))
    ledger.note(claim(1, "a", answered=True))
    ledger.note(claim(2, "a"))
    assert ledger.next(frozenset({"a", "b"})) is None
    free = ledger.next(frozenset({"b"}))
    assert free is not None
    assert free.id.seq == 2


def test_a_claim_may_come_before_its_keyframe():
    ledger = AssignmentTable()
    ledger.note(claim(1, "a", answered=True))
    ledger.add(frame(1))
    assert ledger.next(frozenset()) is None


def test_old_answered_claims_are_forgotten_and_recent_claims_are_kept():
    ledger = AssignmentTable()
    for seq in range(1000):
        ledger.note(claim(seq, "a", answered=True))
    assert len(ledger._entries) == MOST_REMEMBERED
    ledger.add(frame(1000 - MOST_REMEMBERED))
    assert ledger.next(frozenset()) is None


@settings(deadline=None)
@given(st.lists(st.integers(1, 60), max_size=80))
def test_at_most_the_8_newest_keyframes_are_held(seqs: list[int]):
    ledger = AssignmentTable()
    for seq in seqs:
        before = {key for key, entry in ledger._entries.items() if entry.message is not None}
        before.add(key_of(frame(seq).id))
        given_up = len(ledger.add(frame(seq)))
        after = {key for key, entry in ledger._entries.items() if entry.message is not None}
        assert given_up == len(before - after)
    held = []
    while (message := ledger.next(frozenset({"me"}))) is not None:
        held.append(message.id.seq)
        ledger.note(claim(message.id.seq, "me"))
    first_seen = list(dict.fromkeys(seqs))
    assert len(held) == min(8, len(first_seen))
