"""Where a command may write: checked, and locked for it alone, before any work starts.

A lock is held on an empty hidden file. The system releases it with the process, however that ends, so that nothing has
to be cleaned up after a crash: the file may stay, but it locks nobody out. A file system without locks refuses nobody.
"""

import errno
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from contextvars import ContextVar
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import MAX_NAME, native_path

FOLDER_LOCK = ".mmocap.lock"
"""The name of the lock file in a folder that is written to; that of a file is beside it, its name with ``.lock``."""

_LOCKED_ELSEWHERE = (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK)
_locks: dict[Path, int] = {}  # open lock files of this process
_of_call: ContextVar[list[Path] | None] = ContextVar("_of_call", default=None)  # the locks of the command that runs

Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")


def releases_locks(command: Callable[Arguments, Answer]) -> Callable[Arguments, Answer]:
    """Let a command release what it has locked, however it ends."""

    @wraps(command)
    def releasing(*arguments: Arguments.args, **named: Arguments.kwargs) -> Answer:
        locked: list[Path] = []
        before = _of_call.set(locked)
        try:
            return command(*arguments, **named)
        finally:
            _of_call.reset(before)
            release_locks(locked)

    return releasing


def new_file(path: str | Path, *suffixes: str, force: bool = False) -> Path:
    """``path``, if a file of that name can be written there; it is locked.

    Args:
        path: the file.
        suffixes: endings that it may have.
        force: replace a file that exists.

    Raises:
        InputError: another ending, no such folder, not writable, a file that exists, or another process writes it.
    """
    path = Path(path)
    if path.suffix not in suffixes:
        ending = f"ends in '{path.suffix}'" if path.suffix else "has no ending"
        raise InputError(path, ending, f"end it in {' or '.join(suffixes)}")
    _check_place(path)
    if path.is_dir():
        raise InputError(path, "is a folder", "name a file")
    if path.exists() and not force:
        raise InputError(path, "exists already", "give --force to replace it, or write elsewhere")
    lock(path)
    return path


def new_folder(path: str | Path, *, force: bool = False) -> Path:
    """``path`` as a folder, made if it does not exist (its parent must); it is locked.

    Raises:
        InputError: no such parent, not writable, a file, a folder that holds something, or another process writes it.
    """
    path = Path(path)
    _check_place(path)
    if path.exists() and not path.is_dir():
        raise InputError(path, "is a file", "name a folder")
    if path.is_dir() and not os.access(path, os.R_OK):
        raise InputError(path, "cannot be read", "change its permissions, or write elsewhere")
    if path.is_dir() and any(file.name != FOLDER_LOCK for file in path.iterdir()) and not force:
        raise InputError(path, "holds files already", "give --force to write among them, or name another folder")
    path.mkdir(exist_ok=True)
    lock(path)
    return path


def _check_place(path: Path) -> None:
    """See that a file or folder can be written there, before any work: afterwards it would be in vain."""
    folder = path if os.path.isdir(path) else path.parent
    if len(os.fsencode(native_path(path.name))) > MAX_NAME:  # unfinished and further files have longer names
        raise InputError(path, f"has a name of over {MAX_NAME} bytes", "give a shorter name")
    native_path(os.path.realpath(path))
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "make it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(folder, "cannot be written to", "change its permissions, or write elsewhere")


def lock(output: Path) -> None:
    """Lock a file, whose folder exists, or a folder, until the command ends or :func:`release_locks` is called.

    Raises:
        InputError: another process has locked it, or it cannot be written there.
    """
    place = Path(os.path.realpath(output))
    file = place / FOLDER_LOCK if place.is_dir() else place.with_name(f".{place.name}.lock")
    while file not in _locks:
        try:
            opened = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            problem, remedy = f"cannot be written ({error.strerror})", "check its folder, permissions and free space"
            raise InputError(output, problem, remedy) from None
        if not _lock_opened(opened):
            os.close(opened)
            raise InputError(output, "another mmocap is writing it", "wait until that ends, or write elsewhere")
        if _is_file_of(file, opened):
            _locks[file] = opened
            if (locked := _of_call.get()) is not None:
                locked.append(file)
        else:
            os.close(opened)  # the process that had the lock removed the file before ours was locked


def release_locks(files: list[Path] | None = None) -> None:
    """Release these or all that this process has locked, and remove the lock files."""
    for file in list(_locks) if files is None else files:
        opened = _locks.pop(file)
        with suppress(OSError):  # on Windows, where another process may have opened the file by now
            if sys.platform != "win32":
                file.unlink(missing_ok=True)
            os.close(opened)
            if sys.platform == "win32":  # which removes no open file
                file.unlink(missing_ok=True)


def _is_file_of(file: Path, opened: int) -> bool:
    """Whether an open file is the one that has the name now."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(opened), os.stat(file))
    return False


def _lock_opened(opened: int) -> bool:
    """Whether an open file could be locked, or cannot be locked by anybody."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(opened, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in _LOCKED_ELSEWHERE
    return True
