"""PLY files of all kinds keep all that is not moved."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from test_mesh_io import rewritten, written

from guise.analogy.formats.ply import PlyDocument
from guise.analogy.mesh import MeshError

PLY_HEAD = """ply
format {order} 1.0
comment made by hand
element label 2
property uchar letter
element vertex 5
property uchar quality
property float x
property double y
property float z
property float nx
property float ny
property float nz
property uchar red
property uchar green
property uchar blue
element face {faces}
property list uchar int vertex_indices
property int region
element end 1
property list int float values
end_header
"""
VERTEX = [("quality", "u1"), ("x", "f4"), ("y", "f8"), ("z", "f4"), ("n", "f4", 3), ("c", "u1", 3)]
FACES = {"triangles": [[0, 1, 2], [0, 2, 3]], "mixed": [[0, 1, 2, 3], [1, 4, 2]]}


def ply(order: str, faces: list[list[int]], end: str = "\n") -> bytes:
    """A PLY file with more in it than a mesh needs."""
    places = [(0, 0, 0), (1, 0, 0.125), (1, 1, 0), (0, 1, 0.5), (2, 0.1, 0)]
    head = PLY_HEAD.format(order=order, faces=len(faces)).replace("\n", end).encode()
    if order == "ascii":
        rows = ["65", "66", *(f"{i} {x} {y} {z} 0 0 1 255 51 0" for i, (x, y, z) in enumerate(places))]
        rows += [f"{len(face)} {' '.join(map(str, face))} {i}" for i, face in enumerate(faces)]
        return head + end.join([*rows, "3 0.5 0.25 0.125", ""]).encode()
    mark = "<" if "little" in order else ">"
    kind = np.dtype([(name, mark + code, *more) for name, code, *more in VERTEX])
    table = np.array([(i, *xyz, (0, 0, 1), (255, 51, 0)) for i, xyz in enumerate(places)], kind)
    body = b"AB" + table.tobytes()
    for i, face in enumerate(faces):
        body += bytes([len(face)]) + np.array([*face, i], mark + "i4").tobytes()
    return head + body + np.array([3], mark + "i4").tobytes() + np.ones(3, mark + "f4").tobytes()


ORDERS = ["ascii", "binary_little_endian", "binary_big_endian"]
each_ply = pytest.mark.parametrize(
    ("order", "faces", "end"),
    [(order, faces, end) for order in ORDERS for faces in FACES.values() for end in ("\n", "\r\n")],
)


@each_ply
def test_a_ply_is_read_and_written_as_it_was(
    order: str, faces: list[list[int]], end: str, tmp_path: Path
) -> None:
    data = ply(order, faces, end)
    file = written(tmp_path, data, ".ply")
    assert_array_equal(file.mesh.vertices[:4], [[0, 0, 0], [1, 0, 0.125], [1, 1, 0], [0, 1, 0.5]])
    assert sorted(map(len, faces)) == [3] * len(file.mesh.triangles) + [4] * len(file.mesh.quads)
    assert_allclose(file.document.colours, np.tile([1, 0.2, 0], (5, 1)))
    assert rewritten(file, file.mesh.vertices) == data


@each_ply
def test_a_ply_keeps_all_that_does_not_move(
    order: str, faces: list[list[int]], end: str, tmp_path: Path
) -> None:
    data = ply(order, faces, end)
    file = written(tmp_path, data, ".ply")
    moved = file.mesh.vertices.copy()
    moved[1] += (0.5, 0.25, 0)
    made = rewritten(file, moved)
    assert_array_equal(PlyDocument(made).vertices[: len(moved)], moved)
    back = file.document.encode(PlyDocument(data).vertices, PlyDocument(data).normals)
    assert back == data
    assert data.index(b"end_header") == made.index(b"end_header")
    if order == "ascii":
        pairs = list(zip(data.split(b"\n"), made.split(b"\n"), strict=True))
        first = next(i for i, (line, _) in enumerate(pairs) if line.startswith(b"66")) + 1
        changed = [i for i, (before, after) in enumerate(pairs) if before != after]
        assert first + 1 in changed
        assert set(changed) <= set(range(first, first + 5))
    else:
        assert len(made) == len(data)
        assert made[-40:] == data[-40:]


def test_a_ply_without_its_lone_vertex_moves_it_along(tmp_path: Path) -> None:
    file = written(tmp_path, ply("ascii", FACES["triangles"]), ".ply")
    assert len(file.mesh.vertices) == 4
    up = np.array([0, 0, 1])
    made = PlyDocument(rewritten(file, file.mesh.vertices + up))
    assert_array_equal(made.vertices, file.document.vertices + up)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.97])
def test_a_ply_that_ends_too_early_is_said(order: str, share: float, tmp_path: Path) -> None:
    data = ply(order, FACES["mixed"])
    with pytest.raises(MeshError, match=r"cannot use .*\.ply: ") as error:
        written(tmp_path, data[: int(share * len(data))], ".ply")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("order", ORDERS)
def test_more_rows_than_there_can_be_are_said_at_once(order: str, tmp_path: Path) -> None:
    for name in (b"vertex 5", b"face 2", b"label 2"):
        data = ply(order, FACES["mixed"]).replace(name, name[:-1] + b"99999999999")
        with pytest.raises(MeshError, match="it ends too early"):
            written(tmp_path, data, ".ply")


PLY_BAD = {
    "another file": (lambda data: b"solid" + data, "it is no PLY file"),
    "a type": (lambda data: data.replace(b"float x", b"half x"), "cannot be parsed: property half x"),
    "a format": (lambda data: data.replace(b"ascii", b"zipped"), "cannot be parsed: format zipped"),
    "a name twice": (
        lambda data: data.replace(b"float nx", b"float x"),
        "cannot be parsed: property float x",
    ),
    "no vertices": (lambda data: data.replace(b"element vertex", b"element point"), "no element `vertex`"),
    "no z": (lambda data: data.replace(b"float z", b"float w"), "no x, y and z"),
    "whole numbers": (lambda data: data.replace(b"float x", b"int x"), "are integers"),
    "an id": (lambda data: data.replace(b"4 0 1 2 3 ", b"4 0 1 2 9 "), "a face names vertex 9"),
    "a word": (
        lambda data: data.replace(b"0.125 0 0 1", b"0.125 0 x 1"),
        "`vertex` contains something other",
    ),
    "a row": (lambda data: data.replace(b"4 0 1 2 3 ", b"4 0 1 2 "), "`face` do not match its header"),
    "no faces": (lambda data: data.replace(b"element face", b"element tile"), "5 vertices but no faces"),
}


@pytest.mark.parametrize("name", PLY_BAD)
def test_a_bad_ply_is_said_in_a_sentence(name: str, tmp_path: Path) -> None:
    spoil, said = PLY_BAD[name]
    with pytest.raises(MeshError, match=rf"^cannot use .*\.ply: .*{said}"):
        written(tmp_path, spoil(ply("ascii", FACES["mixed"])), ".ply")


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_ply_of_another_program_goes_through(encoding: str, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(2)
    data = trimesh.exchange.ply.export_ply(ball, encoding=encoding, vertex_normal=True)
    file = written(tmp_path, data, ".ply")
    assert_array_equal(file.mesh.triangles, ball.faces)
    assert rewritten(file, file.mesh.vertices) == data
    (tmp_path / "big.ply").write_bytes(rewritten(file, 2 * file.mesh.vertices))
    big = trimesh.load(tmp_path / "big.ply", process=False)
    assert_allclose(big.vertices, 2 * ball.vertices, atol=1e-6)
    assert_allclose(big.vertex_normals, ball.vertex_normals, atol=1e-6)
