"""What a command writes is its own until it ends: another that would write the same is refused at once.

A claim is a lock on an empty hidden file. The system lets go of it with the process, however that ends, so that nothing
has to be cleaned up after a crash: the file may stay, but is then no lock. A file system without locks refuses nobody.
"""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

from mmocap_warp.errors import InputError

FOLDER_CLAIM = ".mmocap.lock"
"""The name of the file in a folder that is written to; beside a file, its name with ``.lock``."""

_TAKEN = (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK)
_held: dict[Path, int] = {}  # open files


def claim(output: Path) -> None:
    """Claim a file, whose folder exists, or a folder, until :func:`release`.

    Raises:
        InputError: another process has claimed it, or it cannot be written there.
    """
    place = Path(os.path.realpath(output))
    lock = place / FOLDER_CLAIM if place.is_dir() else place.with_name(f".{place.name}.lock")
    while lock not in _held:
        try:
            file = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            problem, remedy = f"cannot be written ({error.strerror})", "check its folder, permissions and free space"
            raise InputError(output, problem, remedy) from None
        if not _locked(file):
            os.close(file)
            raise InputError(output, "another mmocap is writing it", "wait until that ends, or write elsewhere")
        if _is_file_of(lock, file):
            _held[lock] = file
        else:
            os.close(file)  # whoever had it removed it in between


def release() -> None:
    """Let go of all that this process has claimed."""
    for lock, file in _held.items():
        if sys.platform != "win32":
            lock.unlink(missing_ok=True)
        os.close(file)
        if sys.platform == "win32":  # where no open file can be removed; another may have opened it by now
            try:
                lock.unlink(missing_ok=True)
            except OSError:
                continue
    _held.clear()


def _is_file_of(lock: Path, file: int) -> bool:
    """Whether an open file is the one that has the name now."""
    try:
        return os.path.samestat(os.fstat(file), os.stat(lock))
    except FileNotFoundError:
        return False


def _locked(file: int) -> bool:
    """Whether an open file could be locked, or cannot be locked by anybody."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in _TAKEN
    return True
