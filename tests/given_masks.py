"""Masks in the forms in which other programs give them: indexed PNGs, tar archives and run lengths."""

from __future__ import annotations

import io
import struct
import tarfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np


def palette_png(index: np.ndarray, palette: np.ndarray, depth: int = 8, extra: bytes = b"") -> bytes:
    """An indexed PNG, as PIL writes it."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    height, width = index.shape
    bits = np.unpackbits(index[..., None], axis=-1)[..., 8 - depth :].reshape(height, -1)
    rows = np.packbits(bits, axis=1)
    data = b"".join(b"\0" + row.tobytes() for row in rows)
    header = struct.pack(">IIBBBBB", width, height, depth, 3, 0, 0, 0)
    transparency = chunk(b"tRNS", extra) if extra else b""
    body = chunk(b"IHDR", header) + chunk(b"PLTE", palette.tobytes()) + transparency
    return b"\x89PNG\r\n\x1a\n" + body + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


def write_tar(path: Path, *files: tuple[str, bytes], kind: bytes = tarfile.REGTYPE) -> Path:
    """An archive of files, all of one kind."""
    with tarfile.open(path, "w") as archive:
        for name, data in files:
            member = tarfile.TarInfo(name)
            member.size, member.type = len(data), kind
            archive.addfile(member, io.BytesIO(data))
    return path


def plain_rle(mask: np.ndarray) -> list[int]:
    """Run lengths, one pixel at a time."""
    lengths, value = [0], False
    for pixel in mask.T.ravel().tolist():
        if pixel != value:
            lengths.append(0)
            value = pixel
        lengths[-1] += 1
    return lengths


def packed(lengths: list[int]) -> str:
    """As pycocotools packs them (rleToString)."""
    text = ""
    for i, length in enumerate(lengths):
        value, more = length - (lengths[i - 2] if i > 2 else 0), True
        while more:
            bits = value & 31
            value >>= 5
            more = value != (-1 if bits & 16 else 0)
            text += chr((bits | (32 if more else 0)) + 48)
    return text


def rle(mask: np.ndarray, *, pack: bool = True) -> dict[str, Any]:
    """A mask as pycocotools gives it, or with its lengths plain."""
    lengths = plain_rle(mask)
    return {"size": list(mask.shape), "counts": packed(lengths) if pack else lengths}
