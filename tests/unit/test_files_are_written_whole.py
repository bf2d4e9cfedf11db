"""Tests that only `helios_core.atomic_file` writes the files of users."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

LOG = "a log: lines are added to it"
LOCK = "a lock: nothing is written"
MEMORY = "into memory"
LINES = "lines are added, each on the disk before the next; a torn last one is left out when read"
SCRATCH = "in a scratch folder that is renamed as a whole, or goes"
SCRIPT = "a script of the developers: git keeps the old file"

# (file, writing call) -> number of calls, and why they are right
ELSEWHERE = {
    ("shared/helios_core/atomic_file.py", "write_bytes"): (1, "this is the one place"),
    ("shared/helios_core/atomic_file.py", "os.open"): (2, "this is the one place"),
    ("services/helios_recorder/mcap_writer.py", "open"): (
        1,
        "grows for hours; made anew, read when torn",
    ),
    ("services/helios_planner/tasks/database.py", "connect"): (1, "SQLite has a journal"),
    ("services/helios_planner/tasks/database.py", "open"): (1, "to see whether there is room"),
    ("services/helios_planner/tasks/write_proof.py", "os.open"): (1, "a folder, to sync it"),
    ("services/helios_gateway/fleet/queue.py", "connect"): (1, "SQLite has a journal"),
    ("shared/helios_core/orphaned_memory.py", "os.open"): (2, LOCK),
    ("shared/helios_core/orphaned_memory.py", "open"): (1, "shared memory, no file on a disk"),
    ("services/helios_objectmap/persistence.py", "ZipFile"): (1, MEMORY),
    ("services/helios_objectmap/export.py", "savez_compressed"): (1, MEMORY),
    ("services/helios_map2d/snapshots/snapshot.py", "savez_compressed"): (1, MEMORY),
    ("services/helios_gateway/map_arrays.py", "savez_compressed"): (1, MEMORY),
    ("services/helios_gateway/map_archive.py", "ZipFile"): (1, MEMORY),
    ("services/helios_gateway/routes/map_file.py", "ZipFile"): (1, MEMORY),
    ("services/helios_gateway/routes/objects.py", "savez"): (1, MEMORY),
    ("clients/helios_client/replay/results.py", "savez_compressed"): (1, MEMORY),
    ("shared/helios_core/private_file.py", "os.open"): (1, LOCK),
    ("services/helios_gateway/audit_log.py", "open"): (1, LINES),
    ("services/helios_gateway/audit_log.py", "os.open"): (1, LINES),
    ("clients/helios_client/supervision/state_file.py", "open"): (1, LOCK),
    ("clients/helios_client/supervision/child_process.py", "open"): (1, LOG),
    ("clients/helios_client/supervision/child_process.py", "copyfile"): (1, LOG),
    ("clients/helios_eval/runs/process_pool.py", "open"): (1, LOCK),
    ("clients/helios_client/supervision/fork_server.py", "os.open"): (1, LOG),
    ("clients/helios_eval/demo.py", "open"): (1, LOG),
    ("clients/helios_eval/run_folder.py", "open"): (1, LOCK),
    ("clients/helios_eval/episodes/episode_record.py", "open"): (1, LINES),
    ("clients/helios_eval/studies/fleet.py", "open"): (1, LOG),
    ("clients/helios_eval/studies/relocalisation/recordings.py", "savez_compressed"): (1, MEMORY),
    ("clients/helios_eval/studies/startup.py", "open"): (1, LOG),
    ("clients/helios_eval/video/mp4_writer.py", "VideoWriter"): (1, "into what `replacing` gave"),
    ("clients/helios_eval/demo_pictures.py", "savefig"): (1, MEMORY),
    ("clients/helios_eval/report/plots.py", "savefig"): (1, MEMORY),
    ("clients/helios_eval/report/episode_map.py", "savefig"): (1, MEMORY),
    ("clients/helios_eval/report/episode_map.py", "save"): (1, MEMORY),
    ("clients/helios_eval/calibration/charts.py", "savefig"): (1, MEMORY),
    ("scripts/generate_example_flat.py", "ZipFile"): (1, MEMORY),
    ("clients/helios_ros2/interface_build.py", "open"): (1, LOG),
    ("clients/helios_ros2/interface_build.py", "write_text"): (2, SCRATCH),
    ("clients/helios_chaos/chaos_run.py", "copy"): (1, SCRATCH),
    ("clients/helios_chaos/checks.py", "connect"): (1, "only read"),
    ("clients/helios_chaos/faults.py", "open"): (1, "fills the disk"),
    ("clients/helios_chaos/soak_plot.py", "savefig"): (1, MEMORY),
    ("clients/helios_chaos/stack.py", "open"): (1, LOG),
    ("clients/helios_chaos/wall_clock.py", "open"): (1, "in place: processes have mapped it"),
    ("clients/helios_chaos/wall_clock.py", "write_bytes"): (1, SCRATCH),
    ("clients/helios_sim/assets/asset_pack.py", "savez_compressed"): (1, SCRATCH),
    ("clients/helios_sim/assets/asset_pack.py", "write_text"): (2, SCRATCH),
    ("clients/helios_sim/assets/sweethome_library.py", "open"): (1, SCRATCH),
    ("clients/helios_sim/assets/sweethome_library.py", "copyfileobj"): (1, SCRATCH),
    ("scripts/markdown_tables.py", "write_text"): (1, SCRIPT),
    ("scripts/page_of_messages.py", "write_bytes"): (1, SCRATCH),
    ("scripts/generate_proto.py", "write_bytes"): (2, SCRIPT),
    ("scripts/generate_proto.py", "write_text"): (1, SCRIPT),
    ("scripts/generate_sdk.py", "write_text"): (1, SCRIPT),
    ("scripts/lock_versions.py", "write_text"): (2, SCRIPT),
    ("scripts/home_pictures.py", "save"): (1, SCRIPT),
}

WRITES = {
    "write_bytes", "write_text", "fdopen", "mkstemp", "NamedTemporaryFile", "copyfile", "copy2",
    "copyfileobj", "imwrite", "imsave", "savez", "savez_compressed", "savetxt", "savefig",
    "tofile", "to_csv", "urlretrieve", "dump", "VideoWriter", "connect",
}  # fmt: skip
ONLY_OF = {"connect": "sqlite3", "dump": "json", "copy": "shutil", "move": "shutil"}


def written_by(path: Path) -> Iterator[str]:
    """Calls in a module that may write to a file, outside of a block of `replacing`."""
    tree = ast.parse(path.read_text())
    safe = {
        id(inner)
        for block in ast.walk(tree)
        if isinstance(block, ast.With)
        and any("replacing(" in ast.unparse(item.context_expr) for item in block.items)
        for inner in ast.walk(block)
    }
    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and id(call) not in safe and (name := _writer(call)):
            yield name


def _writer(call: ast.Call) -> str:
    """The name of a call that may write to a file; "" for other calls."""
    dotted = ast.unparse(call.func)
    owner, _, name = dotted.rpartition(".")
    constants = [
        node.value
        for node in (*call.args, *(k.value for k in call.keywords if k.arg == "mode"))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    if name in ONLY_OF:
        return name if owner == ONLY_OF[name] else ""
    if dotted == "os.open":
        return dotted
    if name in ("open", "ZipFile", "TarFile"):
        return name if any(set(c) & set("wxa+") and len(c) <= 3 for c in constants) else ""
    if name == "save":  # of an image or an array; others are our own methods
        return name if constants or owner in ("np", "numpy") or call.keywords else ""
    return name if name in WRITES else ""


def test_only_listed_places_write_files_directly() -> None:
    found: Counter[tuple[str, str]] = Counter()
    for folder in ("services", "shared", "clients", "scripts"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if not path.name.endswith("_pb2.py"):
                for name in written_by(path):
                    found[str(path.relative_to(ROOT)), name] += 1
    allowed = {where: times for where, (times, _) in ELSEWHERE.items()}
    assert dict(found) == allowed, (
        "write files with helios_core.atomic_file.write_file or replacing, so that a full disk "
        "leaves the old one; or list the place here, with the reason why that is right"
    )


def test_each_kind_of_writing_call_is_found(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    for line in (
        'p.write_text("a")', 'p.write_bytes(b"a")', 'open(p, "w")', 'p.open("ab+")',
        'p.open(mode="x")', 'zipfile.ZipFile(p, "w")', "os.open(p, 0)", "np.savez(p, a=a)",
        "figure.savefig(p)", "cv2.imwrite(p, a)", 'image.save(p, "PNG")', "json.dump(a, f)",
    ):  # fmt: skip
        module.write_text(line + "\n")
        assert len(list(written_by(module))) == 1, line
        module.write_text(f"with replacing(p) as p:\n    {line}\n")
        assert not list(written_by(module)), line
    for line in ('p.open("rb")', "open(p)", "zipfile.ZipFile(p)", "bus.connect()", "self.save()"):
        module.write_text(line + "\n")
        assert not list(written_by(module)), line
