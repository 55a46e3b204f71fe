"""Thrift's compact protocol, so far as Parquet's footer and page heads need it.

Its description: https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md; Parquet's structures:
https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift.

The library reads the same bytes after this. Where it could take them otherwise than this does, a value is refused: a field that
stands twice, a number that is too large for its kind, a field's number beyond 16 bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

YES, NO, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, STRUCT = 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12
BITS: Final = {I16: 16, I32: 32, I64: 64}
SIGN: Final = 1
DEPTH: Final = 8
LONG_LIST: Final = 15


class Compact:
    """Bytes, read from the beginning. All raise IndexError or ValueError where they are no such thing."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.at = 0

    def heads(self) -> Iterator[tuple[int, int]]:
        """Number and kind of each field of a struct. Whoever asks reads its value before the next."""
        number, seen = 0, set()
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._signed(16)
            if number in seen or number >> 15:
                raise ValueError(f"field {number} stands twice, or has no such number")
            seen.add(number)
            yield number, head & 0xF

    def integer(self, kind: int) -> int | None:
        """A value of `kind`: a whole number, or None for one that is none."""
        if kind in BITS:
            return self._signed(BITS[kind])
        self.skip(kind)
        return None

    def binary(self, kind: int) -> bytes | None:
        """A value of `kind`: its bytes, or None for one that has none."""
        if kind != BINARY:
            self.skip(kind)
            return None
        length = self._varint()
        found = self._data[self.at : self.at + length]
        self.at += length
        if len(found) != length:
            raise ValueError("bytes beyond the end")
        return found

    def items(self, kind: int, of: int) -> Iterator[None]:
        """The members of a list of `of`, each to be read before the next; of any other value none."""
        if kind != LIST:
            self.skip(kind)
            return
        count, found = self._list()
        if count and found != of:
            raise ValueError(f"a list of kind {found}")
        for _ in range(count):
            yield

    def skip(self, kind: int, depth: int = 0) -> None:
        """Go past a value of `kind`."""
        if depth > DEPTH:
            raise ValueError("nested too deeply")
        if kind in BITS:
            self._varint()
        elif kind == BINARY:
            length = self._varint()
            self.at += length
        elif kind in (BYTE, DOUBLE):
            self.at += 1 if kind == BYTE else 8
        elif kind == STRUCT:
            for _, each in self.heads():
                self.skip(each, depth + 1)
        elif kind in (LIST, SET):
            count, each = self._list()
            for _ in range(count):
                self.skip(BYTE if each in (YES, NO) else each, depth + 1)
        elif kind not in (YES, NO):  # a flag of a struct is its kind
            raise ValueError(f"a value of kind {kind}")
        if self.at > len(self._data):
            raise ValueError("bytes beyond the end")

    def _list(self) -> tuple[int, int]:
        head = self._byte()
        return (head >> 4 if head >> 4 < LONG_LIST else self._varint()), head & 0xF

    def _byte(self) -> int:
        self.at += 1
        return self._data[self.at - 1]

    def _varint(self) -> int:
        value = shift = 0
        while True:
            one = self._byte()
            value |= (one & 0x7F) << shift
            shift += 7
            if not one & 0x80:
                return value
            if shift > 63:
                raise ValueError("too large a number")

    def _signed(self, bits: int) -> int:
        value = self._varint()
        if value >> bits:
            raise ValueError(f"a number of more than {bits} bits")
        return (value >> SIGN) ^ -(value & SIGN)
