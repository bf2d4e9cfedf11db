"""Files written whole or not at all.

The new content goes into a temporary file beside the old one, is synced to the disk, and takes the
old one's name in one step. So whoever reads the file, and whoever finds it after a crash or on a
full disk, sees the old or the new content, never half of one.
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

NEW_FILE_MODE = 0o666  # less the umask


def write_file(
    path: Path, data: bytes | str, *, mode: int = NEW_FILE_MODE, sync: bool = True
) -> None:
    """Replace a file, or make one, with these bytes, or this text as UTF-8.

    mode: permissions of a file that is made, less the umask; one that is there keeps its own.
    sync: wait until the disk has it; without, a power cut may lose both. A device or a pipe is
    written to. Raises OSError, and then the old file is as it was.
    """
    content = data.encode() if isinstance(data, str) else data
    if path.exists() and not path.is_file():
        path.write_bytes(content)  # a device, a pipe; a folder raises
        return
    with replacing(path, mode=mode, sync=sync) as temporary:
        temporary.write_bytes(content)


def refusal(path: Path) -> str:
    """Why a file cannot be written there and what to do, where its folder is not there or it is a
    folder; empty where neither is so."""
    if path.is_dir():
        return f"{path} is a folder; name a file in it"
    if not path.parent.is_dir():
        return f"there is no folder {path.parent}; make it first, or choose another"
    return ""


@contextmanager
def replacing(path: Path, *, mode: int = NEW_FILE_MODE, sync: bool = True) -> Iterator[Path]:
    """An empty temporary file beside `path`, with its ending, that takes its place where the block
    ends, and is removed where the block raises. For libraries that write to a path of their own.

    mode, sync: as for `write_file`. Raises OSError.
    """
    target = path.resolve()  # of a link: the file that it leads to
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
    """Remove what processes left that were killed while they wrote `path`. Only for who alone
    writes that file. Raises OSError."""
    target = path.resolve()
    if target.parent.is_dir():
        for left in target.parent.glob(f".{target.stem}.*.new{target.suffix}"):
            left.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # this file system cannot
            raise
    finally:
        os.close(descriptor)
