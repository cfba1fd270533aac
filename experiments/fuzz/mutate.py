"""Changes to files that people, editors, disks and other programs make, and some that only an adversary makes."""

import re
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from corpus import Case

Random = np.random.Generator
NUMBERS = (
    b"0", b"-0", b"-1", b"1e-320", b"5e-324", b"1e-17", b"1e6", b"1e300", b"1.7976931348623157e308", b"1e999",
    b"nan", b"-inf", b"inf", b"2147483648", b"9223372036854775807", b"18446744073709551616", b"1" + b"0" * 40,
    b"9" * 5000, b"0x7fffffff", b"true", b"1_000", b"\xc2\xb2", b"\xd9\xa3", b"1.5.2", b"",
)  # fmt: skip
TEXTS = (
    b"\0", b"\xff", b"\xef\xbb\xbf", b"\r", b"\n\n", b"\x1b[31m", b'"', b"'", b"[" * 5000, b"{" * 2000, b"a." * 3000,
    b"[a]\n", b"[[effect]]\n", b"x" * 100_000, b"<script>alert(1)</script>", b"../../../etc/passwd", b"/dev/zero",
    b",", b";", b"=", b"!!python/object/apply:os.system", b"\xe2\x80\xae", b"nan", b"null",
)  # fmt: skip
WORDS = (0, 1, 2, 3, 5, 6, 7, 8, 9, 14, 15, 16, 17, 18, 127, 255, 2**16, 2**28, 2**31 - 1, 2**31, 2**32 - 1)
"""Integers of 32 bits: tags of MATLAB files, and sizes near what overflows."""
COMPRESSED = 15


def mutant(cases: Sequence[Case], number: int, seed: int) -> Case:
    """The input of a number, which depends on nothing but that number and the seed."""
    random = np.random.default_rng([seed, number])
    case = cases[number % len(cases)]
    content = case.files[case.changed]
    binary = case.changed.endswith(".mat")
    unpacked = random.random() < 0.8 and binary
    if unpacked:
        content = decompressed(content)
    # Half of the texts stay what a program or a person would write, and get beyond the first check of their syntax.
    shaped = not binary and random.random() < 0.5
    changes = SHAPED if shaped else BINARY if binary and random.random() < 0.9 else TEXT
    for _ in range(random.geometric(0.7 if shaped or binary else 0.5)):
        content = changes[random.integers(len(changes))](random, content)
    if not shaped and random.random() < 0.1:
        other = cases[random.integers(len(cases))]
        content = splice(random, content, other.files[other.changed])
    if unpacked and random.random() < 0.3:
        content = compressed(content)
    return replace(case, files=case.files | {case.changed: content})


def place(random: Random, content: bytes) -> int:
    return int(random.integers(len(content) + 1))


def stretch(random: Random, content: bytes) -> tuple[int, int]:
    """Two places, mostly near each other."""
    first = place(random, content)
    return first, min(len(content), first + int(random.geometric(0.05)))


def flip_bit(random: Random, content: bytes) -> bytes:
    changed = bytearray(content)
    if changed:
        changed[random.integers(len(changed))] ^= 1 << int(random.integers(8))
    return bytes(changed)


def set_byte(random: Random, content: bytes) -> bytes:
    changed = bytearray(content)
    if changed:
        changed[random.integers(len(changed))] = int(random.integers(256))
    return bytes(changed)


def set_word(random: Random, content: bytes) -> bytes:
    """Writes a telling integer where the file may have one of its own: at a multiple of four."""
    word = int(WORDS[random.integers(len(WORDS))]).to_bytes(4, "little")
    at = place(random, content) // 4 * 4
    return content[:at] + word + content[at + 4 :]


def delete(random: Random, content: bytes) -> bytes:
    first, last = stretch(random, content)
    return content[:first] + content[last:]


def double(random: Random, content: bytes) -> bytes:
    first, last = stretch(random, content)
    return content[:last] + content[first:]


def truncate(random: Random, content: bytes) -> bytes:
    return content[: place(random, content)]


def insert(random: Random, content: bytes) -> bytes:
    at = place(random, content)
    return content[:at] + TEXTS[random.integers(len(TEXTS))] + content[at:]


def change_number(random: Random, content: bytes) -> bytes:
    """Replaces one number by another that breaks what does not expect it."""
    numbers = list(re.finditer(rb"-?\d[\d.e+-]*", content))
    if not numbers:
        return content
    found = numbers[random.integers(len(numbers))]
    return content[: found.start()] + NUMBERS[random.integers(len(NUMBERS))] + content[found.end() :]


def scale_column(random: Random, content: bytes) -> bytes:
    """Multiplies one number of every line by a power of ten, as an export in another unit does."""
    power, column = int(random.integers(-330, 300)), int(random.integers(6))
    pattern = re.compile(rb"^((?:[-\d.e]+,){%d}[-\d.]+)(?=[,\n])" % column, flags=re.MULTILINE)
    return pattern.sub(rb"\g<1>e%d" % power, content)


def change_value(random: Random, content: bytes) -> bytes:
    """Replaces what stands behind an equals sign."""
    values = list(re.finditer(rb"=[^\n]*", content))
    if not values:
        return content
    kinds = (b"[]", b"{}", b'""', b"[[]]", b"1979-05-27", b'{a = "b"}', b'[1.0, "a"]', b'"../model.toml"', *NUMBERS)
    found = values[random.integers(len(values))]
    return content[: found.start()] + b"= " + kinds[random.integers(len(kinds))] + content[found.end() :]


def move_line(random: Random, content: bytes) -> bytes:
    """Deletes, doubles or moves a line."""
    lines = content.split(b"\n")
    line = lines.pop(int(random.integers(len(lines))))
    for _ in range(int(random.integers(3))):
        lines.insert(int(random.integers(len(lines) + 1)), line)
    return b"\n".join(lines)


def swap_words(random: Random, content: bytes) -> bytes:
    """Puts one word of the file in the place of another."""
    words = list(re.finditer(rb"[\w.]+", content))
    if not words:
        return content
    old, new = (words[i] for i in random.integers(len(words), size=2))
    return content[: old.start()] + new[0] + content[old.end() :]


def splice(random: Random, content: bytes, other: bytes) -> bytes:
    first, last = stretch(random, other)
    at = place(random, content)
    return content[:at] + other[first : last + 64] + content[at:]


def decompressed(content: bytes) -> bytes:
    """A MATLAB file of v5 with its variables as they are inside; anything else as it is."""
    found, at = content[:128], 128
    while at + 8 <= len(content):
        kind, size = (int.from_bytes(content[at + i : at + i + 4], "little") for i in (0, 4))
        if kind not in (14, COMPRESSED):
            return content
        body = content[at + 8 : at + 8 + size]
        found += zlib.decompress(body) if kind == COMPRESSED else content[at : at + 8] + body
        at += 8 + size
    return found


def compressed(content: bytes) -> bytes:
    """The rest of a MATLAB file as one compressed variable, as a program writes whose sums are right."""
    body = zlib.compress(content[128:])
    return content[:128] + COMPRESSED.to_bytes(4, "little") + len(body).to_bytes(4, "little") + body


Change = Callable[[Random, bytes], bytes]
BINARY: tuple[Change, ...] = (set_word, set_word, set_word, flip_bit, set_byte, delete, double, truncate, insert)
SHAPED: tuple[Change, ...] = (change_number, change_number, change_value, scale_column, move_line, swap_words)
TEXT: tuple[Change, ...] = (
    *SHAPED, flip_bit, set_byte, delete, double, truncate, insert,
)  # fmt: skip
