"""The body of a PLY file: rows of elements, text or binary, with lists of any length."""

from __future__ import annotations

from dataclasses import dataclass, field
from struct import Struct, error
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.analogy.formats.decimals import format_rows
from guise.analogy.mesh import MeshError
from guise.common.arrays import F64, Bool, Int

STRUCT_CODES = {
    "i1": "b",
    "u1": "B",
    "i2": "h",
    "u2": "H",
    "i4": "i",
    "u4": "I",
    "f4": "f",
    "f8": "d",
}  # of `struct`


@dataclass(frozen=True)
class Element:
    """An element of the header: name, row count, properties (name, type, type of the length of a list or "")."""

    name: str
    count: int
    properties: list[tuple[str, str, str]]


@dataclass(frozen=True, eq=False)
class Rows:
    """The values of each property, row by row, and the length of each list in every row."""

    values: dict[str, NDArray[Any]] = field(default_factory=dict)
    sizes: dict[str, Int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ColumnChange:
    """New values of some properties: names (w,), values (count, w), and the rows (count,) to change."""

    names: tuple[str, ...]
    values: F64
    rows: Bool


class BinaryBody:
    """A binary body.

    Parameters
    ----------
    data : of the file.   start : offset of the body.   order : "<" or ">".
    """

    def __init__(self, data: bytes, start: int, order: str) -> None:
        self._data, self._at, self._order = data, start, order
        self._tables: dict[
            str, tuple[int, np.dtype[Any], int]
        ] = {}  # offset, row type and count of elements with uniform rows

    def rows(self, element: Element) -> Rows:
        """The rows of the next element.

        Raises
        ------
        MeshError
            When the file ends too early.
        """
        if element.count > len(self._data):
            raise MeshError("it ends too early")
        kind = self._row(element)
        end = self._at + kind.itemsize * element.count
        if end <= len(self._data):
            table = np.frombuffer(self._data, kind, element.count, self._at)
            lengths = [table[_length_field(name)] for name, _, listed in element.properties if listed]
            if all((length == length[:1]).all() for length in lengths):
                self._tables[element.name] = (self._at, kind, element.count)
                self._at = end
                return _table_rows(element, table)
        return self._ragged(element)

    def encode(self, name: str, changes: list[ColumnChange]) -> bytes:
        """The bytes of the file with new values in an element.

        Raises
        ------
        MeshError
            When the lists of the element differ in length.
        """
        if name not in self._tables:
            raise MeshError(f"the rows of its element `{name}` differ in length, which cannot be written")
        place, kind, count = self._tables[name]
        data = bytearray(self._data)
        table = np.frombuffer(data, kind, count, place)
        for change in changes:
            for key, column in zip(change.names, change.values.T, strict=True):
                table[key][change.rows] = column[change.rows]
        return bytes(data)

    def _row(self, element: Element) -> np.dtype[Any]:
        """The type of the rows of an element, if all are like the first one."""
        fields: list[tuple[Any, ...]] = []
        at = self._at
        for name, kind, listed in element.properties:
            if listed:
                length = int(self._number(listed, at)) if element.count else 0
                if not 0 <= length <= len(self._data):
                    raise MeshError(f"a list in its element `{element.name}` has the length {length}")
                fields += [(_length_field(name), self._order + listed), (name, self._order + kind, (length,))]
            else:
                fields.append((name, self._order + kind))
            at = self._at + np.dtype(fields).itemsize
        return np.dtype(fields)

    def _number(self, kind: str, at: int) -> Any:
        if at + np.dtype(kind).itemsize > len(self._data):
            raise MeshError("it ends too early")
        return np.frombuffer(self._data, self._order + kind, 1, at)[0]

    def _ragged(self, element: Element) -> Rows:
        """Read row by row, each with its own length."""
        counts = {
            listed: Struct(self._order + STRUCT_CODES[listed])
            for _, _, listed in element.properties
            if listed
        }
        parts: dict[str, list[bytes]] = {name: [] for name, _, _ in element.properties}
        sizes: dict[str, list[int]] = {name: [] for name, _, listed in element.properties if listed}
        steps = [(name, np.dtype(kind).itemsize, listed) for name, kind, listed in element.properties]
        at, data = self._at, self._data
        try:
            for _ in range(element.count):
                for name, width, listed in steps:
                    length = 1
                    if listed:
                        (length,) = counts[listed].unpack_from(data, at)
                        length = max(length, 0)
                        at += counts[listed].size
                        sizes[name].append(length)
                    parts[name].append(data[at : at + width * length])
                    at += width * length
                if at > len(data):
                    break
        except error:
            at = len(data) + 1
        if at > len(data):
            raise MeshError("it ends too early")
        self._at = at
        kinds = {name: self._order + kind for name, kind, _ in element.properties}
        values = {name: np.frombuffer(b"".join(held), kinds[name]) for name, held in parts.items()}
        return Rows(values, {name: np.array(held, np.intp) for name, held in sizes.items()})


class TextBody:
    """An ASCII body: one row per line.

    Parameters
    ----------
    data : of the file.   start : offset of the body.
    """

    def __init__(self, data: bytes, start: int) -> None:
        self._head, self._lines = data[:start], data[start:].split(b"\n")
        self._filled = [i for i, line in enumerate(self._lines) if line.strip()]
        self._at = 0
        self._read: dict[
            str, tuple[list[int], list[str]]
        ] = {}  # lines and properties of elements without lists

    def rows(self, element: Element) -> Rows:
        """The rows of the next element.

        Raises
        ------
        MeshError
            When the file ends too early, or a row does not match the header.
        """
        lines = self._filled[self._at : self._at + element.count]
        if len(lines) < element.count:
            raise MeshError("it ends too early")
        numbers = self._numbers(lines, element.name)
        rows = _uniform_rows(element, numbers) or _ragged_rows(element, numbers)
        self._at += element.count
        if not rows.sizes:
            self._read[element.name] = lines, [name for name, _, _ in element.properties]
        return rows

    def encode(self, name: str, changes: list[ColumnChange]) -> bytes:
        """The bytes of the file with new values in an element.

        Raises
        ------
        MeshError
            When the element has lists.
        """
        if name not in self._read:
            raise MeshError(f"its element `{name}` has lists, which cannot be written")
        places, names = self._read[name]
        lines = list(self._lines)
        for change in changes:
            columns = [names.index(key) for key in change.names]
            texts = format_rows(change.values[change.rows])
            for row, new in zip(np.flatnonzero(change.rows).tolist(), texts, strict=True):
                lines[places[row]] = _with_numbers(lines[places[row]], columns, new)
        return self._head + b"\n".join(lines)

    def _numbers(self, lines: list[int], name: str) -> F64:
        text = b"\n".join([self._lines[i] for i in lines])
        try:
            return np.fromstring(text, sep=" ") if text else np.empty(0)
        except ValueError:
            raise MeshError(f"a row of its element `{name}` contains something other than numbers") from None


def _with_numbers(line: bytes, columns: list[int], numbers: bytes) -> bytes:
    words = line.split()
    for column, number in zip(columns, numbers.split(), strict=True):
        words[column] = number
    return b" ".join(words) + (b"\r" if line.endswith(b"\r") else b"")


def _uniform_rows(element: Element, numbers: F64) -> Rows | None:
    """The rows of an element if all are as long as the first, otherwise None."""
    rows, at = Rows(), 0
    places: list[tuple[str, int, int]] = []
    for name, _, listed in element.properties:
        length = max(int(numbers[at]), 0) if listed and at < len(numbers) else 1
        places.append((name, at, length))
        at += length + bool(listed)
    if len(numbers) != element.count * at:
        return None
    table = numbers.reshape(element.count, at)
    for (name, place, length), (_, _, listed) in zip(places, element.properties, strict=True):
        if listed and (table[:, place] != length).any():
            return None
        if listed:
            rows.sizes[name] = np.full(element.count, length, np.intp)
        rows.values[name] = table[:, place + bool(listed) :][:, :length].ravel()
    return rows


def _ragged_rows(element: Element, numbers: F64) -> Rows:
    """Read row by row, each with its own length."""
    held = numbers.tolist()
    values: dict[str, list[float]] = {name: [] for name, _, _ in element.properties}
    sizes: dict[str, list[int]] = {name: [] for name, _, listed in element.properties if listed}
    at = 0
    try:
        for _ in range(element.count):
            for name, _, listed in element.properties:
                length = 1
                if listed:
                    length, at = max(int(held[at]), 0), at + 1
                    sizes[name].append(length)
                values[name] += held[at : at + length]
                at += length
    except IndexError:
        at = -1
    if at != len(held):
        raise MeshError(f"the rows of its element `{element.name}` do not match its header")
    found = {name: np.array(numbers) for name, numbers in values.items()}
    return Rows(found, {name: np.array(size, np.intp) for name, size in sizes.items()})


def _length_field(name: str) -> str:
    """The name of the field for the length of a list."""
    return f"length of {name}"


def _table_rows(element: Element, table: NDArray[Any]) -> Rows:
    rows = Rows()
    for name, _, listed in element.properties:
        rows.values[name] = table[name].ravel()
        if listed:
            rows.sizes[name] = table[_length_field(name)].astype(np.intp)
    return rows
