"""What a file holds, as a hash: wherever it lies and whenever it was touched."""

from __future__ import annotations

import hashlib
from pathlib import Path

from mmocap_warp.errors import InputError


def content_hash(file: Path) -> bytes:
    """SHA-256 of a file's bytes.

    Raises:
        InputError: it cannot be read.
    """
    try:
        with file.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").digest()
    except OSError as error:
        raise InputError(file, f"cannot be read ({error})", "check its permissions") from error
