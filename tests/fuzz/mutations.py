"""Damage: what files look like after a bad copy, a slip of the hand, another program, or somebody's malice.

Every function takes random numbers and a file's content and returns the content damaged. Those that know the format
change it where its reader looks: a value for one of another type, a number for an extreme one, an archive's member.
"""

from __future__ import annotations

import gzip
import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from random import Random
from typing import Any

Mutation = Callable[[Random, bytes], bytes]

_NUMBERS = (
    "0", "-0", "-1", "1", "1e308", "-1e308", "1e400", "1e-320", "nan", "inf", "-inf", "NaN", "2147483648", "4294967296",
    "-2147483649", "9223372036854775808", "18446744073709551616", "1" + "0" * 400, "9" * 5000, "0x10", "1_000", "1,5",
    "--1", "1e", ".", "", "\u0663",
)  # fmt: skip
_VALUES = (
    "true", '""', '"text"', "'x'", "[]", "{}", "[[]]", "[1, 2]", '["a"]', "{ a = 1 }", "none", "None", "null",
    "1979-05-27", "@/etc/hostname@", "</World>", "(1, 2)", "()", '"' + "x" * 3000 + '"', "~", "*a", "&a", "!!int",
)  # fmt: skip
_BYTES = (b"\xff\xfe", b"\xc3\x28", b"\x00", b"\xed\xa0\x80", b"\xef\xbb\xbf", b"\xe2\x80\xa8", b"\x1a", b"\x85")
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d.]*(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z_:][\w:]*")
_ASSIGNED = re.compile(r"^([^=:\n]*[=:])[ \t]*([^\n]+)$", re.M)
_EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**63 - 1, 2**63, 2**64 - 1)
_TAR_FIELDS = ((0, 100), (124, 12), (136, 12), (156, 1), (156, 1), (157, 100), (257, 8), (345, 155))  # place, length
_DEPTHS = (3, 100, 3000, 20000)


def any_bytes(random: Random, content: bytes) -> bytes:
    """Damage that needs no knowledge of the format."""
    for _ in range(random.choice((1, 1, 1, 2, 4, 16))):
        content = random.choice(_BYTE_DAMAGES)(random, content)
    return content


def _flip(random: Random, content: bytes) -> bytes:
    return _put(
        content, k := _place(random, content), bytes([content[k] ^ 1 << random.randrange(8)]) if content else b""
    )


def _extreme(random: Random, content: bytes) -> bytes:
    size, order = random.choice((1, 2, 4, 8)), random.choice("<>")
    value = random.choice(_EXTREMES) % 256**size
    return _put(content, _place(random, content), value.to_bytes(size, "little" if order == "<" else "big"))


def _real(random: Random, content: bytes) -> bytes:
    value = random.choice((float("nan"), float("inf"), -1e38, 1e-40, 0.0))
    return _put(content, _place(random, content) & ~3, struct.pack("<f", value))


def _truncate(random: Random, content: bytes) -> bytes:
    return content[: _place(random, content)]


def _delete(random: Random, content: bytes) -> bytes:
    k = _place(random, content)
    return content[:k] + content[k + random.choice((1, 4, 64, 1000)) :]


def _duplicate(random: Random, content: bytes) -> bytes:
    k, size = _place(random, content), random.choice((1, 4, 64, 1000))
    return content[: k + size] + content[k : k + size] * random.choice((1, 1, 20)) + content[k + size :]


def _swap(random: Random, content: bytes) -> bytes:
    size = random.choice((1, 4, 16, 200))
    a, b = sorted((_place(random, content), _place(random, content)))
    if b - a < size:
        return content
    return content[:a] + content[b : b + size] + content[a + size : b] + content[a : a + size] + content[b + size :]


def _blank(random: Random, content: bytes) -> bytes:
    size = random.choice((4, 16, 256))
    return _put(content, _place(random, content), bytes([random.choice((0, 0, 255, 32))]) * size)[: len(content)]


def _odd_bytes(random: Random, content: bytes) -> bytes:
    k = _place(random, content)
    return content[:k] + random.choice(_BYTES) + content[k + random.choice((0, 1)) :]


def _noise(random: Random, content: bytes) -> bytes:
    return _put(content, _place(random, content), random.randbytes(random.choice((1, 4, 32))))


def _nothing_much(random: Random, content: bytes) -> bytes:
    return random.choice((b"", b"\n", b"\x00" * 100, content * 2, content[::-1], random.randbytes(300)))


_BYTE_DAMAGES = (
    _flip, _flip, _extreme, _extreme, _real, _truncate, _delete, _duplicate, _swap, _blank, _odd_bytes, _noise,
    _nothing_much,
)  # fmt: skip


def _place(random: Random, content: bytes) -> int:
    """Somewhere in the content; half of the time in its beginning or end, where formats say what they hold."""
    if not content:
        return 0
    near = min(len(content), 256)
    return random.choice(
        (
            random.randrange(near),
            len(content) - 1 - random.randrange(near),
            random.randrange(len(content)),
            random.randrange(len(content)),
        )
    )


def _put(content: bytes, k: int, piece: bytes) -> bytes:
    return content[:k] + piece + content[k + len(piece) :]


def text(random: Random, content: bytes) -> bytes:
    """Damage to words, numbers, values and lines."""
    lines = content.decode("utf-8", "surrogateescape")
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        lines = random.choice(_TEXT_DAMAGES)(random, lines)
    damaged = lines.encode("utf-8", "surrogateescape")
    return random.choice((_odd_bytes, _truncate, any_bytes))(random, damaged) if random.random() < 0.15 else damaged


def _other_number(random: Random, lines: str) -> str:
    return _replaced(random, lines, _NUMBER, random.choice(_NUMBERS + _VALUES))


def _scaled_number(random: Random, lines: str) -> str:
    found = _drawn(random, lines, _NUMBER)
    if found is None:
        return lines
    changed = random.choice((f"-{found[0]}", f"{found[0]}0", f"{found[0]}.5", f"{found[0]}e9", f"{found[0]}x"))
    return lines[: found.start()] + changed + lines[found.end() :]


def _other_value(random: Random, lines: str) -> str:
    found = _drawn(random, lines, _ASSIGNED)
    if found is None:
        return lines
    return lines[: found.start(2)] + random.choice(_NUMBERS + _VALUES) + lines[found.end(2) :]


def _nested(random: Random, lines: str) -> str:
    found, depth = _drawn(random, lines, _ASSIGNED), random.choice(_DEPTHS)
    left, right = random.choice(
        ("[]", "{}", "()", ["{a=", "}"], ['{"a":', "}"], ["a.", "=1"], ["- ", ""], ["<a>", "</a>"])
    )
    if found is None:
        return lines + left * depth + right * depth
    return lines[: found.start(2)] + left * depth + found[2] + right * random.choice((depth, 0)) + lines[found.end(2) :]


def _nested_block(random: Random, lines: str) -> str:
    """Blocks in blocks, as the formats have them."""
    block = random.choice(('def "a" {\n', "JOINT a\n{\nOFFSET 0 0 0\nCHANNELS 0\n", "[a.a]\n", "begin\n", "<camera>\n"))
    end = random.choice(("}\n", "end\n", "</camera>\n", ""))
    rows, depth = lines.splitlines(keepends=True), random.choice(_DEPTHS)
    k = random.randrange(len(rows) + 1)
    return "".join(rows[:k]) + block * depth + end * depth + "".join(rows[k:])


def _no_word(random: Random, lines: str) -> str:
    return _replaced(random, lines, _WORD, "")


def _other_word(random: Random, lines: str) -> str:
    found = _drawn(random, lines, _WORD)
    return _replaced(random, lines, _WORD, found[0] if found else "word")


def _misspelt(random: Random, lines: str) -> str:
    found = _drawn(random, lines, _WORD)
    if found is None:
        return lines
    k = random.randrange(found.start(), found.end())
    return lines[:k] + random.choice("xZ_ \u00e9\u0663.") + lines[k + random.randrange(2) :]


def _no_line(random: Random, lines: str) -> str:
    rows = lines.splitlines(keepends=True)
    k = random.randrange(len(rows) + 1)
    return "".join(rows[:k] + rows[k + random.choice((1, 1, 5)) :])


def _line_again(random: Random, lines: str) -> str:
    rows = lines.splitlines(keepends=True) or ["\n"]
    k = random.randrange(len(rows))
    return "".join(rows[:k] + [rows[k]] * random.choice((2, 3, 300)) + rows[k + 1 :])


def _lines_swapped(random: Random, lines: str) -> str:
    rows = lines.splitlines(keepends=True) or ["\n"]
    a, b = random.randrange(len(rows)), random.randrange(len(rows))
    rows[a], rows[b] = rows[b], rows[a]
    return "".join(rows)


def _number_missing(random: Random, lines: str) -> str:
    return _replaced(random, lines, _NUMBER, "")


def _number_again(random: Random, lines: str) -> str:
    found = _drawn(random, lines, _NUMBER)
    return lines[: found.end()] + random.choice((" ", ", ", "\t")) + lines[found.start() :] if found else lines


_TEXT_DAMAGES = (
    _other_number, _other_number, _scaled_number, _other_value, _other_value, _nested, _nested_block, _no_word,
    _other_word, _misspelt, _no_line, _line_again, _lines_swapped, _number_missing, _number_again,
)  # fmt: skip


def _drawn(random: Random, lines: str, pattern: re.Pattern) -> re.Match | None:
    """The first match after a random place: quicker than finding all to draw one."""
    k = random.randrange(len(lines) + 1)
    return pattern.search(lines, k) or pattern.search(lines)


def _replaced(random: Random, lines: str, pattern: re.Pattern, new: str) -> str:
    found = _drawn(random, lines, pattern)
    return lines if found is None else lines[: found.start()] + new + lines[found.end() :]


def json_text(random: Random, content: bytes) -> bytes:
    """Damage to a JSON tree: other types, keys that are missing or new, depth; now and then to its text."""
    if random.random() < 0.2:
        return text(random, content)
    tree = json.loads(content)
    for _ in range(random.choice((1, 1, 2))):
        tree = _other_node(random, tree)
    return json.dumps(tree).encode()


def _other_node(random: Random, tree: Any) -> Any:
    if isinstance(tree, dict) and tree and random.random() < 0.8:
        key = random.choice(list(tree))
        changed = dict(tree)
        match random.randrange(5):
            case 0:
                del changed[key]
            case 1:
                changed[random.choice(("x", "", key + "x"))] = changed.pop(key)
            case _:
                changed[key] = _other_node(random, tree[key])
        return changed
    if isinstance(tree, list) and tree and random.random() < 0.8:
        k, changed = random.randrange(len(tree)), list(tree)
        match random.randrange(5):
            case 0:
                del changed[k]
            case 1:
                changed *= 2
            case _:
                changed[k] = _other_node(random, tree[k])
        return changed
    depth = random.choice((3, 100, 400))
    nested: Any = tree
    for _ in range(depth):
        nested = [nested]
    new = (None, True, 0, -1, 1e308, float("nan"), float("inf"), 2**64, 10**400, "", "text", "\ud800", "\x00", [], {})
    return random.choice((*new, [tree], {"a": tree}, [1, "a", None], nested))


def png(random: Random, content: bytes) -> bytes:
    """Damage to a PNG, its checksums made right again half of the time."""
    damaged = bytearray(any_bytes(random, content))
    if random.random() < 0.5:
        k = 8
        while k + 12 <= len(damaged):
            size = int.from_bytes(damaged[k : k + 4], "big")
            end = k + 8 + size
            if end + 4 > len(damaged):
                break
            damaged[end : end + 4] = zlib.crc32(damaged[k + 4 : end]).to_bytes(4, "big")
            k = end + 4
    return bytes(damaged)


def gzipped(mutation: Mutation) -> Mutation:
    """Damage inside a gzip, or to the gzip itself."""

    def damage(random: Random, content: bytes) -> bytes:
        if random.random() < 0.2:
            return any_bytes(random, content)
        return gzip.compress(mutation(random, gzip.decompress(content)), 1)

    return damage


def zipped(random: Random, content: bytes) -> bytes:
    """Damage to a member of a zip archive, to their list, or to the archive itself."""
    if random.random() < 0.25:
        return any_bytes(random, content)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    chosen = random.choice(list(members))
    match random.randrange(8):
        case 0:
            del members[chosen]
        case 1:
            members[random.choice(("x.npy", "../../x", chosen + "x"))] = members.pop(chosen)
        case 2:
            members[chosen] = members[random.choice(list(members))]
        case _:
            members[chosen] = _member(random, chosen, members[chosen])
    changed = io.BytesIO()
    with zipfile.ZipFile(changed, "w") as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return changed.getvalue()


def tarred(random: Random, content: bytes) -> bytes:
    """Damage to a header of a tar archive, its checksum made right again, or anywhere."""
    if random.random() < 0.4:
        return any_bytes(random, content)
    headers = [k for k in range(0, len(content) - 511, 512) if content[k + 257 : k + 262] == b"ustar"]
    start = random.choice(headers)
    header = bytearray(content[start : start + 512])
    at, size = random.choice(_TAR_FIELDS)
    octal, kind = b"%0*o" % (size - 1, random.randrange(8 ** min(size - 1, 11))), random.choice(b"0123456789ADKLSVgxX")
    field = random.choice(
        (octal, b"-1", bytes(size), b"\x80" + random.randbytes(size), b"\xff" * size, b"9" * size, bytes([kind]))
    )
    header[at : at + size] = field[:size].ljust(size, b"\0")
    header[148:156] = b"%06o\0 " % (sum(header) - sum(header[148:156]) + 8 * ord(" "))
    return content[:start] + bytes(header) + content[start + 512 :]


def _member(random: Random, name: str, data: bytes) -> bytes:
    if name.endswith(".json"):
        return json_text(random, data)
    if name.endswith(".npy") and random.random() < 0.7:  # the header says type and shape in Python's own words
        size = int.from_bytes(data[8:10], "little")
        header = text(random, data[10 : 10 + size])[:60000]
        return data[:8] + len(header).to_bytes(2, "little") + header + data[10 + size :]
    return any_bytes(random, data)


def text_or_bytes(random: Random, content: bytes) -> bytes:
    """Damage to a text file: mostly where it says something, sometimes anywhere."""
    return text(random, content) if random.random() < 0.85 else any_bytes(random, content)


def headed(magic: bytes) -> Mutation:
    """Damage to a binary file whose second line is JSON, after a line ``magic``."""

    def damage(random: Random, content: bytes) -> bytes:
        if random.random() < 0.5:
            return any_bytes(random, content)
        line, _, rest = content.removeprefix(magic).partition(b"\n")
        return magic + json_text(random, line).replace(b"\n", b" ") + b"\n" + rest

    return damage
