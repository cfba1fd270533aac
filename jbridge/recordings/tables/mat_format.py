"""Checks the structure of a MATLAB file, v5 to v7, before SciPy reads it.

SciPy's reader trusts the types, sizes and dimensions that a file states, and a damaged file can make it read memory
that is not its own, which ends the process. Here every element is visited first: each lies within the one that
holds it, has a type that belongs there, and holds as many numbers as its dimensions state. The layout is that of
"MAT-File Format" (The MathWorks, R2023b), section "Level 5 MAT-File Format".
"""

import math
import struct
import zlib

HEADER = 128
"""Length of the file's header [byte]."""
LARGEST = 2**28
"""Most that the compressed variables of a file may hold together [byte]: 33 million numbers."""
DEEPEST = 32
"""Most cells and structs within each other; each takes some of the stack."""
MOST_BLANKS = 1024
"""Characters that a text without data may have; they are blanks."""

INT8, INT32, UINT32, MATRIX, COMPRESSED, UTF8 = 1, 5, 6, 14, 15, 16
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
"""Length [byte] of one number, by the type of its element."""
TEXT = (1, 2, 4, 16, 17, 18)
"""Types of elements that hold characters."""
CELL, STRUCT, OBJECT, CHARACTERS, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NUMERIC = range(6, 16)
"""Classes of arrays of numbers."""
COMPLEX = 1 << 11
"""Flag of an array that has an imaginary part."""


def checked(content: bytes) -> bytes:
    """Returns a MATLAB file with its variables decompressed; one of v4 as it is, since it has no such structure.

    Raises:
        ValueError: if an element is damaged, saying which and at what byte of its variable.
    """
    if 0 in content[:4]:
        return content
    order = "<" if content[126:HEADER] == b"IM" else ">"
    whole = [content[:HEADER]]
    position, total = HEADER, 0
    while position < len(content):
        kind, size = full_tag(content, position, order)
        start, position = position, position + 8 + size
        if position > len(content):
            raise ValueError(f"the variable at byte {start} is cut short")
        element = content[start:position]
        if kind == COMPRESSED:
            element = decompressed(element[8:], LARGEST - total)
            total += len(element)
            kind, size = full_tag(element, 0, order)
        if kind != MATRIX or len(element) != 8 + size:
            raise ValueError(f"no whole variable at byte {start}")
        Element(element, order).visit_array(8, len(element), 0)
        whole.append(element)
    return b"".join(whole)


def decompressed(data: bytes, most: int) -> bytes:
    """Returns what was compressed, or raises the ValueError if that is damaged or longer than `most` bytes."""
    stream = zlib.decompressobj()
    try:
        found = stream.decompress(data, most + 1)
    except zlib.error as error:
        raise ValueError(f"a variable that cannot be decompressed: {error}") from None
    if len(found) > most:
        raise ValueError(f"more than {LARGEST} bytes once decompressed")
    if not stream.eof:
        raise ValueError("a compressed variable that is cut short")
    return found


def full_tag(content: bytes, position: int, order: str) -> tuple[int, int]:
    """Returns type and size [byte] of the element at a position, or raises the ValueError if it has none."""
    if position + 8 > len(content):
        raise ValueError(f"cut short at byte {position}")
    kind, size = struct.unpack_from(order + "II", content, position)
    return kind, size


class Element:
    """One variable of a file, whose parts are visited in the order of their positions."""

    def __init__(self, content: bytes, order: str):
        self.content = content
        self.order = order
        self.position = 0

    def visit_array(self, start: int, stop: int, depth: int) -> None:
        """Visits an array of any class; raises the ValueError unless it is whole and ends where it states."""
        if depth > DEEPEST:
            raise ValueError(f"more than {DEEPEST} cells or structs within each other")
        self.position = start
        (flags, _) = self.integers(stop, (UINT32,), 2, 2)
        of_class = flags & 0xFF
        if of_class == OPAQUE:
            for _ in range(3):
                self.data(stop, (INT8, UTF8))
            self.visit_arrays(1, stop, depth)
            return
        dimensions = self.integers(stop, (INT32, UINT32), 2, 32)
        if min(dimensions) < 0:
            raise ValueError(f"a dimension below 0 at byte {self.position}")
        self.data(stop, (INT8, UTF8))
        self.visit_contents(flags, math.prod(dimensions), stop, depth)

    def visit_contents(self, flags: int, count: int, stop: int, depth: int) -> None:
        """Visits what follows an array's name."""
        of_class = flags & 0xFF
        if of_class in NUMERIC:
            for _ in range(2 if flags & COMPLEX else 1):
                self.numbers(stop, count)
        elif of_class == CHARACTERS:
            given = len(self.data(stop, TEXT))
            if given < count and (given or count > MOST_BLANKS):
                raise ValueError(f"fewer characters than {count} at byte {self.position}")
        elif of_class == SPARSE:
            for _ in range(2):
                self.data(stop, (INT32, UINT32))
            for _ in range(2 if flags & COMPLEX else 1):
                self.data(stop, tuple(SIZES))
        elif of_class == CELL:
            self.visit_arrays(count, stop, depth)
        elif of_class in (STRUCT, OBJECT):
            if of_class == OBJECT:
                self.data(stop, (INT8, UTF8))
            self.visit_arrays(count * self.count_fields(stop), stop, depth)
        elif of_class == FUNCTION:
            self.visit_arrays(1, stop, depth)
        else:
            raise ValueError(f"unknown class {of_class} of an array that ends at byte {stop}")

    def visit_arrays(self, count: int, stop: int, depth: int) -> None:
        """Visits arrays that follow each other, those within a cell or a struct."""
        if 8 * count > stop - self.position:
            raise ValueError(f"fewer than {count} arrays at byte {self.position}")
        for _ in range(count):
            kind, size = full_tag(self.content, self.position, self.order)
            start = self.position + 8
            if kind != MATRIX or size % 8 or start + size > stop:
                raise ValueError(f"no whole array at byte {self.position}")
            self.position = start
            if size:
                self.visit_array(start, start + size, depth + 1)
            if self.position != start + size:
                raise ValueError(f"an array that does not end where it states, at byte {start}")

    def count_fields(self, stop: int) -> int:
        """Returns the number of a struct's fields; each name has the same length."""
        (length,) = self.integers(stop, (INT32,), 1, 1)
        names = self.data(stop, (INT8,))
        if length < 1 or len(names) % length:
            raise ValueError(f"names of fields that are damaged at byte {self.position}")
        return len(names) // length

    def numbers(self, stop: int, count: int) -> None:
        """Visits the numbers of an array, of which there must be `count`."""
        kind, start, size = self.tag(stop)
        if kind not in SIZES or size != count * SIZES[kind]:
            raise ValueError(f"no {count} numbers at byte {start}")

    def integers(self, stop: int, kinds: tuple[int, ...], least: int, most: int) -> tuple[int, ...]:
        """Returns the integers of 4 bytes in an element, `least` to `most` of them."""
        start = self.position
        data = self.data(stop, kinds)
        if len(data) % 4 or not least <= len(data) // 4 <= most:
            raise ValueError(f"no {least} to {most} integers at byte {start}")
        return struct.unpack(f"{self.order}{len(data) // 4}i", data)

    def data(self, stop: int, kinds: tuple[int, ...]) -> bytes:
        """Returns the data of an element, whose type must be one of `kinds`."""
        before = self.position
        kind, start, size = self.tag(stop)
        if kind not in kinds:
            raise ValueError(f"an element of type {kind} at byte {before}, where {listed_types(kinds)} belongs")
        return self.content[start : start + size]

    def tag(self, stop: int) -> tuple[int, int, int]:
        """Returns type, start and size of the element at the position, which moves behind it and its padding."""
        before = self.position
        if before + 8 > stop:
            raise ValueError(f"cut short at byte {before}")
        kind, size = full_tag(self.content, before, self.order)
        start = before + 8
        if kind >> 16:  # up to four bytes stand in the tag itself
            kind, size, start = kind & 0xFFFF, kind >> 16, before + 4
            if size > 4:
                raise ValueError(f"{size} bytes in a tag of 4 at byte {before}")
            self.position = before + 8
        else:
            self.position = min(start + size + -size % 8, stop)
        if start + size > stop:
            raise ValueError(f"an element that is cut short at byte {before}")
        return kind, start, size


def listed_types(kinds: tuple[int, ...]) -> str:
    return " or ".join(map(str, kinds))
