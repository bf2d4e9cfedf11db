"""Atomic replacement of files.

The new content goes into a temporary file beside the old one, is synced to the disk, and takes the
old name in one step. A reader sees the complete old or the complete new content, also after a crash
or on a full disk.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

NEW_FILE_MODE = 0o666  # before the umask


def write_file(
    path: Path, data: bytes | str, *, mode: int = NEW_FILE_MODE, sync: bool = True
) -> None:
    """Write bytes, or text as UTF-8, to a new or existing file.

    mode: permissions of a new file, less the umask; an existing file keeps its permissions.
    sync: wait until the content is on the disk; without it, a power cut may lose old and new
    content. Devices and pipes are written directly. Raises OSError; the old file then stays
    unchanged.
    """
    content = data.encode() if isinstance(data, str) else data
    if path.exists() and not path.is_file():
        path.write_bytes(content)  # a device, a pipe; a folder raises
        return
    with replacing(path, mode=mode, sync=sync) as temporary:
        temporary.write_bytes(content)


def unwritable_reason(path: Path) -> str:
    """Error text with a remedy if `path` is a folder or its folder does not exist, else empty."""
    if path.is_dir():
        return f"{path} is a folder; name a file in it"
    if not path.parent.is_dir():
        return f"there is no folder {path.parent}; make it first, or choose another"
    return ""


@contextmanager
def replacing(path: Path, *, mode: int = NEW_FILE_MODE, sync: bool = True) -> Iterator[Path]:
    """Yield an empty temporary file beside `path`, with the same suffix.

    It replaces `path` when the block ends and is removed when the block raises. For libraries that
    write to a path. mode, sync: as for `write_file`. Raises OSError.
    """
    target = path.resolve()  # for a link: its target
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}.new{target.suffix}")
    os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode))
    try:
        with contextlib.suppress(FileNotFoundError):
            temporary.chmod(stat.S_IMODE(target.stat().st_mode))
        yield temporary
        if sync:
            _sync(temporary)
        temporary.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
    if sync:
        _sync(target.parent)


def remove_temporaries(path: Path) -> None:
    """Remove temporary files of processes that were killed while they wrote `path`.

    Only for the sole writer of that file. Raises OSError.
    """
    target = path.resolve()
    if target.parent.is_dir():
        for left in target.parent.glob(f".{target.stem}.*.new{target.suffix}"):
            left.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # the file system has no fsync
            raise
    finally:
        os.close(descriptor)
