"""Record what a process does on the bus; a test puts this folder first on PYTHONPATH.

Each process writes `FOLDER/<module>.<pid>.txt` with one line `operation key` for everything it did
at least once. FOLDER is the variable HELIOS_TEST_BUS_FOLDER.
"""

import os
import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import PathFinder

FOLDER = os.environ.get("HELIOS_TEST_BUS_FOLDER", "")
MODULE = "helios_core.zenoh_bus"


def _record(bus_class) -> None:
    module = sys.orig_argv[sys.orig_argv.index("-m") + 1] if "-m" in sys.orig_argv else "other"
    path = os.path.join(FOLDER, f"{module}.{os.getpid()}.txt")
    seen = set()

    def note(operation: str, key: str) -> None:
        if (operation, key) not in seen:
            seen.add((operation, key))
            with open(path, "a") as file:
                file.write(f"{operation} {key}\n")

    def wrap(method: str, operation: str, key_of) -> None:
        original = getattr(bus_class, method)

        def wrapped(self, *args, **kwargs):
            note(operation, key_of(self, *args))
            return original(self, *args, **kwargs)

        setattr(bus_class, method, wrapped)

    def of_topic(self, topic, *_) -> str:
        return topic.key(self.robot)

    wrap("publish", "put", of_topic)
    wrap("_subscribe", "subscribe", of_topic)
    wrap("serve", "serve", of_topic)
    wrap("_ask", "call", of_topic)
    wrap("announce", "announce", lambda self, service, *_: f"{self.robot} {service}")
    wrap("watch", "watch", lambda self, *_: self.robot)


class _Finder(MetaPathFinder):
    """Finder of the one module, whose class is changed after its import."""

    def find_spec(self, name, path=None, target=None):
        if name != MODULE:
            return None
        spec = PathFinder.find_spec(name, path)
        if spec is not None and spec.loader is not None:
            spec.loader = _Recording(spec.loader)
        return spec


class _Recording(Loader):
    def __init__(self, loader) -> None:
        self._loader = loader

    def create_module(self, spec):
        return self._loader.create_module(spec)

    def exec_module(self, module) -> None:
        self._loader.exec_module(module)
        _record(module.ZenohBus)


if FOLDER:
    sys.meta_path.insert(0, _Finder())
