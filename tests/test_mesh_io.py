"""OBJ files keep all that is not moved; sequences of files."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from guise.analogy.formats.decimals import format_rows
from guise.analogy.formats.files import MeshFile, read_frames, read_mesh
from guise.analogy.formats.obj import ObjDocument, read_obj_positions
from guise.analogy.mesh import MeshError
from guise.common.arrays import F64

HEAD = b"""# made by hand \xe2\x80\x94 with care
mtllib my colours.mtl
o Head of Ann

v 0 0 0
v 1.000000 0 0
v   1 1 0.25
v 0 1 0 # a corner
v 2e0 0 0.5
v 2 1 .75
v 3 0.5 1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vt 0.5 0.5
vn 0 0 1
vn 0 -0.6 0.8
g left side
usemtl skin 1
s 1
f 1/1/1 2/2/1 3/3/1 4/4/1
g right side
usemtl lips
f 2/1/2 5/2/2 7/5/2 6/3/2 3/4/2
l 1 2
"""
EXAMPLES = {
    "all": HEAD,
    "crlf": HEAD.replace(b"\n", b"\r\n"),
    "cr": HEAD.replace(b"\n", b"\r"),
    "no last end": HEAD.rstrip(),
    "tabs": HEAD.replace(b"v ", b"v\t").replace(b"f ", b"  f\t"),
    "positions only": re.sub(rb"/\d+/\d+", b"", HEAD),
    "no normals": re.sub(rb"(/\d+)/\d+", rb"\1", HEAD),
    "no uvs": re.sub(rb"/\d+(/\d+)", rb"/\1", HEAD),
    "mixed": HEAD.replace(b"1/1/1 2/2/1", b"1//1 2/2"),
    "negative": HEAD.replace(b"f 1/1/1 2/2/1 3/3/1", b"f -7/-5/-2 -6/-4/-2 -5/-3/-2"),
    "gone on": HEAD.replace(b"2/2/1 3/3/1", b"2/2/1 \\\n 3/3/1"),
    "colours": re.sub(rb"(?m)^(v [^#\n]+?)( #.*)?$", rb"\1 0.5 0.25 1\2", HEAD),
    "weights": re.sub(rb"(?m)^(v [^#\n]+?)( #.*)?$", rb"\1 1.0\2", HEAD),
}


def written(tmp_path: Path, data: bytes, suffix: str = ".obj") -> MeshFile:
    path = tmp_path / f"my head{suffix}"
    path.write_bytes(data)
    return read_mesh(path)


def rewritten(file: MeshFile, vertices: F64) -> bytes:
    path = file.path.with_name("other" + file.path.suffix)
    file.write(path, vertices)
    return path.read_bytes()


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_obj_is_read_however_it_is_written(name: str, tmp_path: Path) -> None:
    file = written(tmp_path, EXAMPLES[name])
    assert_array_equal(file.mesh.vertices[[4, 5]], [[2, 0, 0.5], [2, 1, 0.75]])
    assert_array_equal(file.mesh.quads, [[0, 1, 2, 3]])
    assert_array_equal(file.mesh.triangles, [[1, 4, 6], [1, 6, 5], [1, 5, 2]])
    assert_array_equal(read_obj_positions(EXAMPLES[name]), file.mesh.vertices)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_obj_with_its_own_vertices_is_the_same_file(name: str, tmp_path: Path) -> None:
    file = written(tmp_path, EXAMPLES[name])
    assert rewritten(file, file.mesh.vertices) == EXAMPLES[name]


@pytest.mark.parametrize("name", EXAMPLES)
def test_only_the_lines_of_what_moves_change(name: str, tmp_path: Path) -> None:
    data = EXAMPLES[name]
    file = written(tmp_path, data)
    moved = file.mesh.vertices.copy()
    moved[3] = (-1 / 3, 1e-9, 12345.678)
    made = rewritten(file, moved)
    before, after = re.split(rb"\r?\n|\r", data), re.split(rb"\r?\n|\r", made)
    changed = [(b, a) for b, a in zip(before, after, strict=True) if b != a and not b.startswith(b"vn")]
    assert len(changed) == 1
    assert changed[0][1].split()[:4] == [b"v", b"-0.333333", b"0.000000", b"12345.678000"]
    assert changed[0][1].split()[4:] == changed[0][0].split()[4:]
    assert made.count(b"\r") == data.count(b"\r")
    assert_allclose(ObjDocument(made).vertices, moved, atol=1e-6)


def test_normals_of_an_obj_follow(tmp_path: Path) -> None:
    file = written(tmp_path, HEAD)
    back = file.mesh.vertices @ np.diag([1.0, -1.0, -1.0])  # half a turn around x
    normals = ObjDocument(rewritten(file, back)).normals
    assert normals is not None
    assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    assert (normals[:, 2] < -0.5).all()


@given(st.data())
def test_any_obj_is_read_as_plain_python_reads_it(data: st.DataObject) -> None:
    """Polygons of any sides, corners written in any way, counted from either end, between other lines."""
    count = data.draw(st.integers(3, 8))
    numbers = st.floats(-1e6, 1e6, allow_subnormal=False)
    vertices = data.draw(st.lists(st.tuples(numbers, numbers, numbers), min_size=count, max_size=count))
    polygons = data.draw(
        st.lists(st.lists(st.integers(1, count), min_size=3, max_size=6), min_size=1, max_size=5)
    )
    forms = st.sampled_from(["{v}", "{v}/1", "{v}//1", "{v}/1/1", "{b}", "{b}/-1/-1"])
    between = st.sampled_from(["", "# v 1 2 3", "g a b", "s off", "\t", "usemtl vn f"])
    lines = ["vt 0.5 0.5", "vn 0 0 1", *(f"v {x!r} {y!r} {z!r}" for x, y, z in vertices)]
    for polygon in polygons:
        form = data.draw(forms)
        lines.append(data.draw(between))
        lines.append("f " + " ".join(form.format(v=v, b=v - count - 1) for v in polygon))
    text = data.draw(st.sampled_from(["\n", "\r\n"])).join(lines).encode()
    found = ObjDocument(text)
    assert_array_equal(found.vertices, vertices)
    assert found.polygons.sizes.tolist() == [len(polygon) for polygon in polygons]
    assert (found.polygons.corners + 1).tolist() == [v for polygon in polygons for v in polygon]
    assert found.encode(found.vertices, found.normals) == text


@given(st.lists(st.tuples(*[st.floats(-1e12, 1e12)] * 3), min_size=1, max_size=9), st.integers(-12, 0))
def test_numbers_are_written_as_python_writes_them(rows: list[tuple[float, ...]], scale: int) -> None:
    values = np.array(rows) * 10.0**scale
    largest = np.abs(values).max()
    for text, row in zip(format_rows(values), values.tolist(), strict=True):
        assert_allclose(
            [float(word) for word in text.split()], row, rtol=1e-8, atol=max(1e-8 * largest, 1e-15)
        )
        assert all(re.fullmatch(rb"-?\d+\.\d{6,15}|-?[\d.]+(e[-+]\d+)?", word) for word in text.split())
        assert len(text.split()) == 3


def test_as_many_decimals_as_the_largest_needs() -> None:
    assert format_rows(np.array([[0.25, -1 / 3, 100]])) == [b"0.250000 -0.333333 100.000000"]
    assert format_rows(np.array([[-1e-9, 1 / 3, 0]])) == [b"-0.000000001 0.333333333 0.000000000"]
    assert format_rows(np.array([[1e10, 1, 0]])) == [b"1e+10 1 0"]
    assert format_rows(np.zeros((0, 3))) == []


BAD = {
    "too short": (HEAD.replace(b"v 2 1 .75", b"v 2 1"), r"line 10 must hold 3 finite numbers, got: v 2 1"),
    "a word": (
        HEAD.replace(b"v 2 1 .75", b"v 2 one 1"),
        r"line 10 must hold 3 finite numbers, got: v 2 one 1",
    ),
    "nan": (HEAD.replace(b"v 2 1 .75", b"v 2 nan 1"), r"line 10 must hold 3 finite numbers, got: v 2 nan 1"),
    "overflow": (HEAD.replace(b"v 2 1 .75", b"v 2 1e999 1"), r"1 of its 7 vertices are not finite"),
    "out of range": (HEAD.replace(b"f 1/", b"f 8/"), r"line 22 names a `v` line that does not exist .* 7\)"),
    "far": (HEAD.replace(b"f 1/1/1", b"f 99999999999999999999"), r"line 22 names a `v` line"),
    "zero": (HEAD.replace(b"f 1/", b"f 0/"), r"line 22 names a `v` line"),
    "before the first": (HEAD.replace(b"f 1/", b"f -8/"), r"line 22 names a `v` line"),
    "no such normal": (HEAD.replace(b"1/1/1 2", b"1/1/3 2"), r"line 22 names a `vn` line"),
    "no number": (HEAD.replace(b"f 1/", b"f x/"), r"line 22 must hold vertex numbers, got: f x/1/1"),
    "no faces": (HEAD.replace(b"f ", b"p "), r"7 vertices but no faces: point clouds"),
    "empty": (b"", "it is empty: export the mesh again"),
    "something else": (bytes(range(256)) * 9, "it is no OBJ file, which would have `v` lines"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_obj_is_said_in_a_sentence(name: str, tmp_path: Path) -> None:
    data, said = BAD[name]
    with pytest.raises(MeshError, match=rf"^cannot use .*my head\.obj: .*{said}") as error:
        written(tmp_path, data)
    assert "\n" not in str(error.value)


def test_an_obj_with_vertices_split_at_seams_is_one_surface(tmp_path: Path) -> None:
    """As exporters write it that count position, texture coordinate and normal by one id."""
    split = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nv 1 0 0\nv 1 1 0\n"
    uvs = b"".join(b"vt %g 0\n" % (i / 8) for i in range(8))
    faces = b"f 1/1 2/2 3/3 4/4\nf 7/7 5/5 6/6 8/8\n"
    file = written(tmp_path, split + uvs + faces)
    assert len(file.mesh.vertices) == 6
    assert rewritten(file, file.mesh.vertices) == split + uvs + faces
    made = ObjDocument(rewritten(file, file.mesh.vertices * (1, 1, 1) + file.mesh.vertices[:, :1] ** 2))
    assert_array_equal(made.vertices[[1, 2]], made.vertices[[6, 7]])
    own_ids = faces.replace(b"7/7", b"7/1").replace(b"1/1", b"1/3")
    assert len(written(tmp_path, split + uvs + own_ids + b"f 1/5 2/6 3/7\n").mesh.vertices) == 8


def test_materials_and_pictures_go_along(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "skin.png").write_bytes(b"\x89PNG")
    (tmp_path / "my colours.mtl").write_text("newmtl skin 1\nmap_Kd -s 1 1 1 maps/skin.png\nbump ../no.png\n")
    file = written(tmp_path, HEAD)
    file.write(tmp_path / "out" / "head.obj", file.mesh.vertices)
    (tmp_path / "out" / "my colours.mtl").write_text("kept")
    file.write(tmp_path / "out" / "head2.obj", file.mesh.vertices)
    assert (tmp_path / "out" / "maps" / "skin.png").read_bytes() == b"\x89PNG"
    assert (tmp_path / "out" / "my colours.mtl").read_text() == "kept"


def test_what_is_no_mesh_file_is_said(tmp_path: Path) -> None:
    (tmp_path / "head.stl").touch()
    for name, said in (
        ("head.stl", "suffix must be .obj, .ply, .glb, .gltf or .vrm"),
        ("no.obj", "does not exist"),
    ):
        with pytest.raises(MeshError, match=said):
            read_mesh(tmp_path / name)


def test_the_format_stays(tmp_path: Path) -> None:
    file = written(tmp_path, HEAD)
    with pytest.raises(MeshError, match=r"its suffix must be \.obj"):
        file.write(tmp_path / "head.ply", file.mesh.vertices)
    with pytest.raises(MeshError, match="not finite"):
        file.write(tmp_path / "nan.obj", file.mesh.vertices * np.nan)
    assert [path.name for path in tmp_path.iterdir()] == ["my head.obj"]


def test_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = written(tmp_path, HEAD)

    def full(part: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        file.write(tmp_path / "other.obj", file.mesh.vertices)
    assert [path.name for path in tmp_path.iterdir()] == ["my head.obj"]


def test_frames_are_read_in_natural_order(tmp_path: Path) -> None:
    file = written(tmp_path, HEAD)
    folder = tmp_path / "frames"
    for frame in (10, 9, 1, 100):
        file.write(folder / f"take 2 {frame}.obj", file.mesh.vertices * frame)
    (folder / "notes.txt").touch()
    frames = list(read_frames(folder, file))
    assert [name for name, _ in frames] == [f"take 2 {frame}" for frame in (1, 9, 10, 100)]
    assert_allclose(frames[2][1], 10 * file.mesh.vertices)


def test_frames_of_another_mesh_are_said(tmp_path: Path) -> None:
    file = written(tmp_path, HEAD)
    folder = tmp_path / "frames"
    with pytest.raises(MeshError, match=r"the file does not exist"):
        next(read_frames(folder, file))
    file.write(folder / "1.obj", file.mesh.vertices)
    (folder / "2.obj").write_bytes(HEAD.replace(b"v 2 1 .75\n", b""))
    frames = read_frames(folder, file)
    next(frames)
    with pytest.raises(MeshError, match=r"2\.obj has 6 vertices, but its neutral .*my head\.obj has 7"):
        next(frames)
    (tmp_path / "empty").mkdir()
    with pytest.raises(MeshError, match="holds no OBJ or PLY files"):
        next(read_frames(tmp_path / "empty", file))


def test_an_expression_is_read_for_the_clean_vertices(tmp_path: Path) -> None:
    """The first vertex of the file is in no face."""
    faces = b"v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 2 3 4\n"
    file = written(tmp_path, faces)
    (tmp_path / "smile.obj").write_bytes(faces.replace(b"v 0 1 0", b"v 0 2 0"))
    assert_array_equal(file.read_expression(tmp_path / "smile.obj"), [[0, 0, 0], [1, 0, 0], [0, 2, 0]])
