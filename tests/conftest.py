"""Lets tests import `tests.support`; takes the time limit off every property test; hears Ctrl-C;
sees to it that no two tests have one name; tells at the end why tests were skipped; makes the
garbage collector leave alone what lives as long as the tests."""

import gc
import signal
import sys
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

# How long an example takes says how busy the machine is. What may not take long is counted.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# A shell has what it runs in the background ignore Ctrl-C, nohup has it ignore the end of the
# terminal, and so would all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# At Python's 700 the collector takes a fifth of the time of a process that has all tests imported.
gc.set_threshold(10_000, 10, 10)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Each reason once, with how many tests it skipped."""
    skipped: list[pytest.TestReport] = terminalreporter.stats.get("skipped", [])
    said = (report.longrepr for report in skipped)
    reasons = Counter(str(it[-1]) if isinstance(it, tuple) else str(it) for it in said)
    if reasons:
        terminalreporter.section(f"{len(skipped)} skipped")
    for reason, count in reasons.most_common():
        terminalreporter.line(f"{count:4d}  {reason.removeprefix('Skipped: ')}")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of tests of one name, workers that share the tests run one and say nothing of the others."""
    twice = [name for name, count in Counter(item.nodeid for item in items).items() if count > 1]
    if twice:
        raise pytest.UsageError(f"several tests are called {', '.join(twice)}; rename them")


def pytest_collection_finish() -> None:
    """Of a million objects that the imports left, none is garbage."""
    gc.collect()
    gc.freeze()
