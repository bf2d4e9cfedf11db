"""Configure all tests.

Makes `tests.support` importable, removes the deadline of property tests, restores SIGINT and
SIGHUP, refuses two tests of one name, lists the reasons of skipped tests at the end, and keeps
long-lived objects out of garbage collection.
"""

import gc
import signal
import sys
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

# The duration of an example depends on the load of the machine. Tests of cost count operations.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# A shell makes background processes ignore SIGINT, and nohup makes them ignore SIGHUP. Every
# process that a test starts would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# With Python's default of 700, a process that has imported all tests spends a fifth of its time in
# garbage collection.
gc.set_threshold(10_000, 10, 10)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List each skip reason once, with the number of tests that it skipped."""
    skipped: list[pytest.TestReport] = terminalreporter.stats.get("skipped", [])
    said = (report.longrepr for report in skipped)
    reasons = Counter(str(it[-1]) if isinstance(it, tuple) else str(it) for it in said)
    if reasons:
        terminalreporter.section(f"{len(skipped)} skipped")
    for reason, count in reasons.most_common():
        terminalreporter.line(f"{count:4d}  {reason.removeprefix('Skipped: ')}")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Refuse tests of one name: parallel workers run one of them and silently drop the others."""
    twice = [name for name, count in Counter(item.nodeid for item in items).items() if count > 1]
    if twice:
        raise pytest.UsageError(f"several tests are called {', '.join(twice)}; rename them")


def pytest_collection_finish() -> None:
    """Freeze the million objects that the imports created: none of them is garbage."""
    gc.collect()
    gc.freeze()
