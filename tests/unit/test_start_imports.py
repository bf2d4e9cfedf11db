"""What each process of `helios up` may import when it starts: imports cost seconds and memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

# Needed by the core of every service.
CORE = {
    "annotated_types", "cv2", "dotenv", "foxglove_schemas_protobuf", "google", "numpy", "pydantic",
    "pydantic_core", "pydantic_settings", "typing_extensions", "typing_inspection", "zenoh",
}  # fmt: skip
KERNELS = {"llvmlite", "numba", "scipy", "scipy.version", "yaml"}
RECORDINGS = {"lz4", "mcap", "zstandard"}
WEB = {
    "annotated_doc", "anyio", "click", "deprecated", "fastapi", "fastapi_offline", "limits",
    "opentelemetry",  # by fastapi if it is installed
    "packaging", "prometheus_client", "python_multipart", "starlette", "uvicorn", "wrapt",
}  # fmt: skip
MAY_IMPORT = {
    "router": {"foxglove_schemas_protobuf", "google", "zenoh"},
    "supervisor": {
        "annotated_doc", "annotated_types", "foxglove_schemas_protobuf", "google", "pydantic",
        "pydantic_core", "rich", "shellingham", "typer", "typing_extensions", "typing_inspection",
        "zenoh",
    },
    "fork server": CORE | KERNELS | {"cffi", "pycparser", "scipy.linalg", "setproctitle"},
    "world": CORE | {"OpenGL", "mujoco", "scipy", "scipy.linalg", "scipy.sparse", "scipy.version"},
    "bridge": CORE,
    "detector": CORE,
    "objectmap": CORE | KERNELS | {"scipy.special"},
    "map2d": CORE | KERNELS,
    "planner": CORE | KERNELS,
    "gateway": CORE | WEB | RECORDINGS,
    "recorder": CORE | RECORDINGS,
    "services": CORE | KERNELS | WEB | RECORDINGS | {"scipy.special"},  # of `helios up --compact`
}  # fmt: skip
NOISE = {"charset_normalizer", "cython_runtime"}  # by-products of numpy and of compiled modules

BUS = "from helios_core.memory_bus import MemoryBus, MemoryHub; bus = MemoryBus(MemoryHub())\n"
START = {
    "router": "import helios_core.router",
    "supervisor": "import helios_client.cli\n"
    "import helios_client.supervision.forked_process, helios_client.supervision.up\n"
    "import helios_client.supervision.up_flags, helios_core.zenoh_bus",
    "fork server": "from helios_client.supervision import fork_server\n"
    "fork_server._import(fork_server.SHARED); fork_server._prepare_numba()\n"
    "import os; assert len(os.listdir('/proc/self/task')) == 1",
    "world": "import helios_sim.__main__",
    "bridge": BUS + "import helios_bridge.__main__ as bridge\n"
    "bridge.load_driver(bridge.Settings.load(['--driver', 'sim']), bus)",
    "detector": BUS + "import helios_detector.__main__ as detector\n"
    "from helios_detector.model_set import open_models\n"
    "from helios_detector.simulator_truth import BusTruth\n"
    "open_models(detector.Settings.load([]), BusTruth(bus))",
    "objectmap": "import helios_objectmap.__main__",
    "map2d": "import helios_map2d.__main__",
    "planner": "import helios_planner.__main__",
    "gateway": "import helios_gateway.__main__",
    "recorder": "import helios_recorder.__main__",
    "services": "import helios_core.compact_process\n"
    + "\n".join(
        f"import helios_{name}.__main__"
        for name in ("bridge", "detector", "objectmap", "map2d", "planner", "gateway")
    ),
}
REPORT = """
import json, sys
names = set()
for module in list(sys.modules):
    parts = module.split(".")
    deep = parts[0] == "scipy" and len(parts) > 1 and not parts[1].startswith("_")
    names.add(".".join(parts[:2]) if deep else parts[0])
print(json.dumps(sorted(names - sys.stdlib_module_names)))
"""


@pytest.mark.parametrize("process", MAY_IMPORT)
def test_a_process_imports_at_its_start_only_what_it_needs(process: str) -> None:
    if process == "fork server" and sys.platform != "linux":
        pytest.skip("only Linux has a fork server")
    alone = {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", START[process] + REPORT],
        env=os.environ | alone,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    names = {n for n in json.loads(done.stdout) if not n.startswith(("_", "helios_"))}
    unexpected = names - MAY_IMPORT[process] - NOISE
    assert not unexpected, (
        f"the start of {process} imports {', '.join(sorted(unexpected))}; import it inside the "
        "function that needs it, or add it to MAY_IMPORT if every start needs it"
    )
