"""Wavefront OBJ: reads polygons, and writes a file by changing the `v` and `vn` lines that were read.

Everything else (order, groups, texture coordinates, materials, comments, line ends) stays byte for byte, as do lines of
vertices that do not move.  No library keeps all that: trimesh splits vertices at texture seams, meshio and libigl
drop groups and comments, tinyobjloader does not write.  NumPy parses as fast as they do.
"""

from __future__ import annotations

import re
from functools import cached_property

import numpy as np

from guise.analogy.formats.decimals import format_rows
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import MeshError, printable_excerpt
from guise.analogy.normals import finite_or_zero
from guise.common.arrays import F64, Int

LINE_KEYWORDS = (b"v", b"vn", b"vt", b"f", b"o", b"g", b"us", b"mt")  # the last two by their beginnings
MAX_INDEX = 1 << 40  # larger than any vertex id
SPACES = (ord(" "), ord("\t"))
_NO_KEYWORD = bytes.maketrans(b"vntf", b"    ")
_NO_SLASH = bytes.maketrans(b"/", b" ")


class ObjDocument:
    """An OBJ file.

    Parameters
    ----------
    data : its bytes.

    Attributes
    ----------
    vertices : (n, 3).   polygons : its `f` lines with three corners or more.
    normals : (k, 3) of its `vn` lines.   normal_ids : (c,) of each corner; both None if a corner has none.
    uvs, uv_ids : likewise of its `vt` lines, (m, 2).

    Raises
    ------
    MeshError
        When a line cannot be parsed.
    """

    def __init__(self, data: bytes) -> None:
        self.lines, self._end = _split_lines(data)
        self._where = _lines_by_keyword(self.lines)
        self.vertices = _parse_vectors(self.lines, self._where[b"v"], 3)[:, :3]
        if not len(self.vertices):
            raise MeshError("it is no OBJ file, which would have `v` lines")
        corners, sizes, self._face_lines = _parse_faces(self.lines, self._where)
        self.polygons = Polygons(corners[:, 0], sizes)
        self.uv_ids = corners[:, 1] if len(corners) and corners[:, 1].min() >= 0 else None
        self.normal_ids = corners[:, 2] if len(corners) and corners[:, 2].min() >= 0 else None

    @cached_property
    def normals(self) -> F64 | None:
        return (
            None
            if self.normal_ids is None
            else finite_or_zero(_parse_vectors(self.lines, self._where[b"vn"], 3)[:, :3])
        )

    @cached_property
    def uvs(self) -> F64 | None:
        return None if self.uv_ids is None else _parse_vectors(self.lines, self._where[b"vt"], 2)[:, :2]

    @cached_property
    def colours(self) -> F64 | None:
        """(n, 3) from 0 to 1, if they follow every position."""
        columns = _parse_vectors(self.lines, self._where[b"v"], 3)
        return columns[:, 3:6] if columns.shape[1] >= 6 else None

    def material_ids(self) -> tuple[list[str], Int]:
        """The names of `usemtl` lines ("" before the first), and (p,) the index for each polygon."""
        return self._ids_by(self._lines_of(b"usemtl"))

    def part_ids(self) -> list[tuple[list[str], Int]]:
        """The names of objects, of groups and of materials, each with (p,) the index for each polygon."""
        return [self._ids_by(self._where[b"o"]), self._ids_by(self._where[b"g"]), self.material_ids()]

    def _ids_by(self, changes: list[int]) -> tuple[list[str], Int]:
        """The names in some lines ("" before the first), and (p,) the index of the last before each polygon."""
        called = [_rest(self.lines[i]) for i in changes]
        names = list(dict.fromkeys(["", *called]))
        ids = np.array([0, *(names.index(name) for name in called)], np.intp)
        return names, ids[np.searchsorted(changes, self._face_lines)]

    def libraries(self) -> list[str]:
        """The names in its `mtllib` lines."""
        return [_rest(self.lines[i]) for i in self._lines_of(b"mtllib")]

    def _lines_of(self, keyword: bytes) -> list[int]:
        """The indices of the lines with a longer keyword."""
        return [i for i in self._where[keyword[:2]] if self.lines[i].lstrip().startswith(keyword)]

    def encode(self, vertices: F64, normals: F64 | None) -> bytes:
        """The bytes of the file with other vertices (n, 3) and normals (k, 3)."""
        lines = list(self.lines)
        _rewrite(lines, self._vertex_tails, b"v ", self.vertices, vertices)
        if normals is not None and self.normals is not None:
            _rewrite(lines, self._normal_tails, b"vn ", self.normals, normals)
        return self._end.join(lines)

    @cached_property
    def _vertex_tails(self) -> list[tuple[int, bytes]]:
        return _tails(self.lines, self._where[b"v"])

    @cached_property
    def _normal_tails(self) -> list[tuple[int, bytes]]:
        return _tails(self.lines, self._where[b"vn"])


def read_obj_positions(data: bytes) -> F64:
    """Only the vertices (n, 3) of an OBJ file.

    Raises
    ------
    MeshError
        When a `v` line cannot be parsed.
    """
    block = _vertex_block(data)
    quick = None if block is None else _parse_table(*block, 3)
    if quick is not None:
        return quick[:, :3]
    lines, _ = _split_lines(data)
    return _parse_vectors(lines, _lines_by_keyword(lines)[b"v"], 3)[:, :3]


def _vertex_block(data: bytes) -> tuple[bytes, int] | None:
    """The text of the `v` lines of a file and their number, if they form one regular block."""
    if any(odd in data for odd in (b"\\", b"\n ", b"\n\t")) or b"\n" not in data:
        return None
    letters = np.frombuffer(b"\n" + data + b"\n  ", np.uint8)
    ends = np.flatnonzero(letters == ord("\n"))
    at = np.flatnonzero((letters[ends[:-1] + 1] == ord("v")) & np.isin(letters[ends[:-1] + 2], SPACES))
    if not len(at) or at[-1] - at[0] + 1 != len(at):
        return None
    text = data[ends[at[0]] : ends[at[-1] + 1] - 1]
    return None if b"#" in text else (text.translate(_NO_KEYWORD), len(at))


def _split_lines(data: bytes) -> tuple[list[bytes], bytes]:
    """The lines of a file, joined where a backslash continues them, and their separator."""
    end = b"\n" if b"\n" in data or b"\r" not in data else b"\r"
    lines = data.split(end)
    if b"\\\n" not in data and b"\\\r" not in data:
        return lines, end
    whole: list[bytes] = []
    for line in lines:
        if whole and whole[-1].rstrip(b"\r").endswith(b"\\") and not whole[-1].startswith(b"#"):
            whole[-1] += end + line
        else:
            whole.append(line)
    return whole, end


def _lines_by_keyword(lines: list[bytes]) -> dict[bytes, list[int]]:
    """The indices of the lines with each keyword."""
    letters = np.array([line[:2] for line in lines], "S2").view(np.uint8).reshape(-1, 2)
    for i in np.flatnonzero(np.isin(letters[:, 0], SPACES)).tolist():
        letters[i] = np.array([lines[i].lstrip()[:2]], "S2").view(np.uint8)
    space = np.isin(letters[:, 1], SPACES)
    found = {}
    for kind in LINE_KEYWORDS:
        second = space if len(kind) == 1 else letters[:, 1] == kind[1]
        found[kind] = np.flatnonzero((letters[:, 0] == kind[0]) & second).tolist()
    return found


def _parse_vectors(lines: list[bytes], where: list[int], least: int) -> F64:
    """(n, columns) the numbers in lines, as many as all of them have, at least `least`."""
    found = _parse_table(_join_values(lines, where), len(where), least)
    if found is None:
        for i in where:
            if _parse_table(_join_values(lines, [i]), 1, least) is None:
                raise _line_error(lines, i, f"must hold {least} finite numbers")
    return np.zeros((0, least)) if found is None else found


def _parse_table(text: bytes, count: int, least: int) -> F64 | None:
    """(count, columns) the numbers in lines, as many as all of them have; None when a line has fewer than `least`."""
    starts, owners = _token_starts(text)
    counts = np.bincount(owners, minlength=count)
    if (counts < least).any():
        return None
    try:
        numbers = np.fromstring(text, sep=" ") if len(starts) else np.empty(0)
    except ValueError:
        return None
    if len(numbers) != len(starts):
        return None
    columns = int(counts.min()) if count else least
    return np.asarray(numbers[(np.cumsum(counts) - counts)[:, None] + np.arange(columns)], np.float64)


def _join_values(lines: list[bytes], where: list[int]) -> bytes:
    """The text of lines without keywords and comments."""
    text = b"\n".join([lines[i] for i in where])
    if b"#" in text:
        text = b"\n".join([lines[i].partition(b"#")[0] for i in where])
    if b"\\" in text:
        text = re.sub(rb"\\\r?\n", b" ", text)
    return text.translate(_NO_KEYWORD)


def _token_starts(text: bytes) -> tuple[Int, Int]:
    """Offset of each word of a text, and its line."""
    symbols = np.frombuffer(text, np.uint8)
    dark = symbols > ord(" ")
    first = dark.copy()
    first[1:] &= ~dark[:-1]
    starts = np.flatnonzero(first)
    return starts, np.searchsorted(np.flatnonzero(symbols == ord("\n")), starts)


def _line_error(lines: list[bytes], place: int, wrong: str) -> MeshError:
    number = sum(line.count(b"\n") + 1 for line in lines[:place]) + 1
    return MeshError(
        f"line {number} {wrong}, got: {printable_excerpt(lines[place].decode('utf-8', 'replace'))}"
    )


def _rest(line: bytes) -> str:
    """The rest of a line after its keyword."""
    return b"".join(line.split(None, 1)[1:]).strip().decode("utf-8", "replace")


def _parse_faces(lines: list[bytes], where: dict[bytes, list[int]]) -> tuple[Int, Int, Int]:
    """Corners (c, 3), 0-based ids of position, texture coordinate and normal (-1: none), sizes (p,) and lines (p,)."""
    text = _join_values(lines, where[b"f"])
    starts, owners = _token_starts(text)
    corners = _parse_uniform_corners(text, starts)
    if corners is None:
        corners = _parse_corners(lines, where[b"f"])
    at = np.array(where[b"f"], np.intp)
    for column, kind in enumerate((b"v", b"vt", b"vn")):
        _to_zero_based(corners[:, column], lines, where[kind], at[owners], kind)
    sizes = np.bincount(owners, minlength=len(at))
    return corners[(sizes >= 3)[owners]], sizes[sizes >= 3], at[sizes >= 3]


def _parse_uniform_corners(text: bytes, starts: Int) -> Int | None:
    """Ids (c, 3) as written, 0 where missing, if all corners are written alike; otherwise None."""
    if not len(starts):
        return np.zeros((0, 3), np.intp)
    slashes = np.add.reduceat(np.frombuffer(text, np.uint8) == ord("/"), starts, dtype=np.intp)
    double = text.count(b"//")
    columns = {(0, 0): [0], (1, 0): [0, 1], (2, 0): [0, 1, 2], (2, len(starts)): [0, 2]}.get(
        (int(slashes[0]), double)
    )
    if columns is None or (slashes != slashes[0]).any():
        return None
    try:
        numbers = np.fromstring(text.translate(_NO_SLASH), np.intp, sep=" ")
    except ValueError:
        return None
    if len(numbers) != len(starts) * len(columns):
        return None
    corners = np.zeros((len(starts), 3), np.intp)
    corners[:, columns] = numbers.reshape(len(starts), -1)
    return corners


def _parse_corners(lines: list[bytes], where: list[int]) -> Int:
    """Ids (c, 3) as written, corner by corner."""
    corners = []
    for place in where:
        try:
            for corner in _join_values(lines, [place]).split():
                corners.append(
                    [
                        max(-MAX_INDEX, min(int(part or 0), MAX_INDEX))
                        for part in (*corner.split(b"/"), b"", b"")[:3]
                    ]
                )
        except ValueError:
            raise _line_error(lines, place, "must hold vertex numbers") from None
    return np.array(corners, np.intp).reshape(-1, 3)


def _to_zero_based(ids: Int, lines: list[bytes], defined: list[int], faces: Int, kind: bytes) -> None:
    """Convert ids as written (from 1, or backwards from -1) to 0-based ones, in place; faces : (c,) their lines."""
    back = ids < 0
    ids[back] += np.searchsorted(np.array(defined, np.intp), faces[back]) + 1
    wrong = np.flatnonzero((ids > len(defined)) | ((ids < 1) if kind == b"v" else back & (ids < 1)))
    if len(wrong):
        what = f"names a `{kind.decode()}` line that does not exist (the file has {len(defined)})"
        raise _line_error(lines, faces[wrong[0]], what)
    ids -= 1


def _tails(lines: list[bytes], where: list[int]) -> list[tuple[int, bytes]]:
    """The lines at `where`, and the text after the three numbers of each."""
    return [(i, _tail(lines[i])) for i in where]


def _tail(line: bytes) -> bytes:
    body, mark, comment = line.partition(b"#")
    words = body.split(None, 4)
    end = b"\r" if line.endswith(b"\r") else b""
    rest = b" " + words[4] if len(words) > 4 else b""
    return rest + (b" " + mark + comment if mark else b"" if rest.endswith(b"\r") else end)


def _rewrite(lines: list[bytes], tails: list[tuple[int, bytes]], keyword: bytes, old: F64, new: F64) -> None:
    """Replace the numbers in the lines whose vector changes, in place."""
    moved = np.flatnonzero((old != new).any(axis=1)).tolist()
    for i, text in zip(moved, format_rows(new[moved]), strict=True):
        place, tail = tails[i]
        lines[place] = keyword + text + tail
