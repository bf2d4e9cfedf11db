"""Check of output files before a long run."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_client.usage_errors import UsageError, check_writable


def test_a_file_for_the_end_of_a_long_run_is_checked_and_its_folder_made(tmp_path: Path) -> None:
    check_writable(tmp_path / "new" / "run.json")
    assert (tmp_path / "new").is_dir()
    (tmp_path / "file").write_text("")
    for path, says in (
        (tmp_path / "new", "is a folder; name a file in it"),
        (tmp_path / "file" / "run.json", "choose another"),
        (tmp_path / "file" / "deeper" / "run.json", "cannot be made: .*; choose another"),
    ):
        with pytest.raises(UsageError, match=says):
            check_writable(path)
