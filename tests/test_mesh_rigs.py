"""Rigs as GLB with morph targets, and their animations."""

import base64
import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from test_mesh import grid, sheet, slit
from test_mesh_gltf import PLACED, SIDE2, TRIANGLES, Glb, document, head, ways

from guise.analogy.formats.files import MeshFile, read_frames, read_mesh, read_rig, write_rig
from guise.analogy.formats.gltf import GltfDocument
from guise.analogy.formats.gltf_container import GltfContainer
from guise.analogy.mesh import MeshError
from guise.common.arrays import F64

OBJ = (
    "mtllib sheet.mtl\n"
    + "".join(f"v {x} {y} {z}\n" for x, y, z in sheet())
    + "".join(f"vt {u} {v}\n" for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)))
    + "usemtl skin\n"
    + "".join("f " + " ".join(f"{v + 1}/{k + 1}" for k, v in enumerate(quad)) + "\n" for quad in grid()[:40])
    + "usemtl lips\n"
    + "".join("f " + " ".join(f"{v + 1}/{k + 1}" for k, v in enumerate(quad)) + "\n" for quad in grid()[40:])
)
MTL = "newmtl skin\nKd 1 0.5 0.25\nmap_Kd skin.png\nnewmtl lips\nKd 1 0 0\nd 0.5\n"


def targets(tmp_path: Path, suffix: str) -> MeshFile:
    path = tmp_path / f"target{suffix}"
    if suffix == ".obj":
        path.write_text(OBJ)
        (tmp_path / "sheet.mtl").write_text(MTL)
        (tmp_path / "skin.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    elif suffix == ".ply":
        ball = trimesh.Trimesh(sheet(), TRIANGLES, process=False)
        ball.visual.vertex_colors = [255, 188, 0, 255]
        ball.export(path)
    else:
        path.write_bytes(head({"old": sheet()}, **PLACED).data())
    return read_mesh(path)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_a_rig_is_what_was_written(suffix: str, tmp_path: Path) -> None:
    target = targets(tmp_path, suffix)
    shapes = target.mesh.vertices + np.stack(list(ways().values()))
    write_rig(tmp_path / "rig.glb", target, list(ways()), shapes)
    rig = read_rig(tmp_path / "rig.glb")
    assert rig.names == tuple(ways())
    assert_allclose(rig.file.mesh.vertices, target.mesh.vertices, atol=1e-6)
    assert_allclose(rig.shapes, shapes, atol=1e-6)
    seen = trimesh.load(tmp_path / "rig.glb", process=False)
    assert_allclose(seen.bounds, [target.mesh.vertices.min(0), target.mesh.vertices.max(0)], atol=1e-5)
    assert sum(len(part.faces) for part in seen.dump()) == len(target.mesh.faces)
    made = document(tmp_path / "rig.glb")
    assert made["meshes"][0]["extras"]["targetNames"] == list(ways())
    assert all(len(primitive["targets"]) == 3 for primitive in made["meshes"][0]["primitives"])


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_a_rig_turns_its_normals(suffix: str, tmp_path: Path) -> None:
    """A head thrown back by 30 degrees has its normals turned by as much."""
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    target = targets(tmp_path, suffix)
    write_rig(tmp_path / "rig.glb", target, ["back"], (target.mesh.vertices @ turn.T)[None])
    data = (tmp_path / "rig.glb").read_bytes()
    container, held = GltfContainer.read(data, tmp_path), GltfDocument(data, tmp_path)
    (part,) = held.parts
    local = container.read_accessor(part.primitives[0]["attributes"]["NORMAL"])
    moved = local + container.read_accessor(part.targets()[0]["NORMAL"])
    assert held.normals is not None
    assert_allclose(part.normals_to_scene(moved), held.normals @ turn.T, atol=1e-2)


def test_a_rig_of_an_obj_has_its_materials(tmp_path: Path) -> None:
    target = targets(tmp_path, ".obj")
    write_rig(tmp_path / "rig.glb", target, ["a"], target.mesh.vertices[None] + 1)
    made = document(tmp_path / "rig.glb")
    skin, lips = made["materials"]
    assert (skin["name"], lips["name"]) == ("skin", "lips")
    assert skin["pbrMetallicRoughness"]["baseColorFactor"] == [1, 0.5, 0.25, 1]
    assert made["images"][made["textures"][0]["source"]]["mimeType"] == "image/png"
    assert (lips["alphaMode"], lips["pbrMetallicRoughness"]["baseColorFactor"]) == ("BLEND", [1, 0, 0, 0.5])
    counts = [made["accessors"][p["indices"]]["count"] for p in made["meshes"][0]["primitives"]]
    assert counts == [240, 144]
    held = GltfDocument((tmp_path / "rig.glb").read_bytes(), tmp_path)
    assert held.uvs is not None
    assert_array_equal(np.unique(held.uvs, axis=0), [[0, 0], [0, 1], [1, 0], [1, 1]])
    assert_array_equal(held.uvs[(held.vertices == held.vertices[0]).all(1)], [[0, 1]])  # v up becomes v down


def test_texture_coordinates_given_corner_by_corner_split_no_vertex(tmp_path: Path) -> None:
    """As some exporters write them: one for each corner, though all around a vertex are the same."""
    corners = np.arange(TRIANGLES.size).reshape(-1, 3)
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in sheet())
    text += "".join(f"vt {u!r} {v!r}\n" for u, v, _ in sheet()[TRIANGLES.ravel()].tolist())
    for ids, own in zip((TRIANGLES + 1).tolist(), (corners + 1).tolist(), strict=True):
        text += "f " + " ".join(f"{v}/{t}" for v, t in zip(ids, own, strict=True)) + "\n"
    (tmp_path / "a.obj").write_text(text)
    target = read_mesh(tmp_path / "a.obj")
    write_rig(tmp_path / "rig.glb", target, ["a"], target.mesh.vertices[None] + 1)
    assert len(read_mesh(tmp_path / "rig.glb").document.vertices) == SIDE2


def test_a_rig_of_a_ply_has_its_colours(tmp_path: Path) -> None:
    target = targets(tmp_path, ".ply")
    write_rig(tmp_path / "rig.glb", target, ["a"], target.mesh.vertices[None] + 1)
    held = GltfDocument((tmp_path / "rig.glb").read_bytes(), tmp_path)
    assert_allclose(
        held.colours, np.tile([1, 0.5029, 0], (SIDE2, 1)), atol=1e-4
    )  # 188 is half as bright as 255


def test_only_meshes_that_move_get_targets(tmp_path: Path) -> None:
    made = head(ways(2))
    made.node(mesh=made.mesh(sheet() / 8, TRIANGLES), translation=[0.0, 0, 3])
    source = made.read(tmp_path)
    shapes = read_rig(source.path).shapes
    write_rig(tmp_path / "rig.glb", source, ["x", "y"], shapes)
    meshes = document(tmp_path / "rig.glb")["meshes"]
    assert meshes[0]["extras"]["targetNames"] == ["x", "y"]
    assert "targets" not in meshes[1]["primitives"][0]
    assert_allclose(read_rig(tmp_path / "rig.glb").shapes, shapes, atol=1e-6)


def test_targets_of_one_name_on_several_meshes_are_one(tmp_path: Path) -> None:
    first, second, third = ways().values()
    made = head({"smile": first, "blink": second})
    made.node(mesh=made.mesh(sheet() + 4, TRIANGLES, {"blink": third}), scale=[2.0, 2, 2])
    rig = read_rig(made.read(tmp_path).path)
    assert rig.names == ("smile", "blink")
    moved = rig.shapes - rig.file.mesh.vertices
    assert_array_equal(moved, [np.concatenate([first, 0 * first]), np.concatenate([second, 2 * third])])


def test_targets_without_names_are_numbered(tmp_path: Path) -> None:
    made = head(ways(2))
    made.json["meshes"][0]["extras"]["targetNames"] = ["only one"]
    assert read_rig(made.read(tmp_path).path).names == ("only one", "target_01")


def test_lips_that_a_rig_opens_stay_apart(tmp_path: Path) -> None:
    vertices, quads, _ = slit(sheet(), grid())
    opening = np.zeros_like(vertices)
    opening[SIDE2:] = (0, 0.5, 0)
    made = Glb()
    made.node(
        mesh=made.mesh(
            vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), {"open": opening}
        )
    )
    rig = read_rig(made.read(tmp_path).path)
    assert_array_equal(rig.shapes[0] - rig.file.mesh.vertices, opening)


def animated(method: str = "LINEAR") -> Glb:
    """Two targets at keys 0, 1 and 3 s; a node that turns besides."""
    made = head(ways(2), **PLACED)
    made.node(mesh=made.mesh(sheet() + 9, TRIANGLES, ways(1)), weights=[0.5])
    keys = made.accessor(np.array([0.0, 1, 3]))
    values = np.array([[0, 1], [1, 0], [0.5, 0.25]])
    if method == "CUBICSPLINE":
        values = np.stack([values - 1, values, values + 2], axis=1)  # into a key, at it, out of it
    moves = {"input": made.accessor(np.array([0.0, 1, 3])), "output": made.accessor(np.zeros((3, 3)))}
    weights = {"input": keys, "output": made.accessor(values.reshape(-1, 1)), "interpolation": method}
    made.json["animations"] = [
        {"channels": [{"sampler": 0, "target": {"node": 0, "path": path}}], "samplers": [sampler]}
        for path, sampler in (("translation", moves), ("weights", weights))
    ]
    return made


def weights_of(made: Glb, tmp_path: Path, rate: float | None) -> tuple[list[str], F64]:
    """Names of the frames, and the weights (f, 2) that explain them."""
    file = made.read(tmp_path)
    frames = list(read_frames(file.path, file, rate))
    (first, _) = GltfDocument(made.data(), tmp_path).parts
    shapes = np.stack(list(ways(2).values())) @ first.matrix[:3, :3].T
    moved = np.stack([vertices - file.mesh.vertices for _, vertices in frames])
    assert_allclose(
        moved[:, SIDE2:], np.broadcast_to(ways()["jawOpen 0"] / 2, moved[:, SIDE2:].shape), atol=1e-6
    )
    solved = np.linalg.lstsq(shapes.reshape(2, -1).T, moved[:, :SIDE2].reshape(len(frames), -1).T, rcond=None)
    assert_allclose(solved[1], 0, atol=1e-9)
    return [name for name, _ in frames], solved[0].T


@pytest.mark.parametrize("method", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_the_keys_of_an_animation_are_frames(method: str, tmp_path: Path) -> None:
    names, weights = weights_of(animated(method), tmp_path, None)
    assert names == ["0000", "0001", "0002"]
    assert_allclose(weights, [[0, 1], [1, 0], [0.5, 0.25]], atol=1e-6)


def test_an_animation_is_sampled_between_its_keys(tmp_path: Path) -> None:
    linear = [[0, 1], [0.5, 0.5], [1, 0], [0.875, 0.0625], [0.75, 0.125], [0.625, 0.1875], [0.5, 0.25]]
    assert_allclose(weights_of(animated(), tmp_path, 2)[1], linear, atol=1e-6)
    step = [[0, 1], [0, 1], [1, 0], [1, 0], [1, 0], [1, 0], [0.5, 0.25]]
    assert_allclose(weights_of(animated("STEP"), tmp_path, 2)[1], step, atol=1e-6)


def test_splines_are_those_of_scipy(tmp_path: Path) -> None:
    from scipy.interpolate import CubicHermiteSpline

    names, weights = weights_of(animated("CUBICSPLINE"), tmp_path, 5)
    values = np.array([[0, 1], [1, 0], [0.5, 0.25]])
    first = CubicHermiteSpline([0, 1], values[:2], [values[0] + 2, values[1] - 1])
    second = CubicHermiteSpline([1, 3], values[1:], [values[1] + 2, values[2] - 1])
    times = np.arange(16) / 5
    assert len(names) == 16
    assert_allclose(weights, np.where(times[:, None] <= 1, first(times), second(times)), atol=1e-6)


def test_what_animates_old_targets_is_dropped(tmp_path: Path) -> None:
    source = animated().read(tmp_path)
    write_rig(tmp_path / "rig.glb", source, ["x"], source.mesh.vertices[None] + 1)
    made = document(tmp_path / "rig.glb")
    assert [c["target"]["path"] for a in made["animations"] for c in a["channels"]] == ["translation"]
    assert all("weights" not in node for node in made["nodes"])


@pytest.mark.slow
def test_a_document_with_anything_in_it_is_a_sentence_or_a_mesh(tmp_path: Path) -> None:
    """Every value of the JSON in turn is another."""
    path, whole = tmp_path / "made.gltf", animated()
    address = "data:;base64," + base64.b64encode(whole.buffer).decode()
    whole.json["buffers"] = [{"uri": address}]

    def places(held: Any, way: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        inner = held.items() if isinstance(held, dict) else enumerate(held) if isinstance(held, list) else ()
        return [way, *(place for key, value in inner for place in places(value, (*way, key)))]

    said = []
    odd = (None, -1, 10**9, "x")
    for i, way in enumerate(places(whole.json)[1:]):
        for other in (odd[i % 4], odd[(i + 1) % 4]):
            held = spoilt = copy.deepcopy(whole.json)
            for key in way[:-1]:
                held = held[key]
            held[way[-1]] = other
            path.write_text(json.dumps(spoilt))
            try:
                list(read_frames(path, read_rig(path).file))
            except MeshError as error:
                said.append(str(error))
    assert len(said) > 100
    assert not any("\n" in sentence for sentence in said)


def test_a_rig_needs_targets_and_a_sequence_an_animation(tmp_path: Path) -> None:
    file = head().read(tmp_path)
    with pytest.raises(MeshError, match=r"made\.glb: it has no morph targets: give a GLB, glTF or VRM file"):
        read_rig(file.path)
    with pytest.raises(MeshError, match=r"made\.glb: it has no animation of morph targets"):
        next(read_frames(file.path, file))
    (tmp_path / "other.glb").write_bytes(animated().data())
    with pytest.raises(MeshError, match=r"other\.glb has 162 vertices, but its neutral .*made\.glb has 81"):
        next(read_frames(tmp_path / "other.glb", file))


def test_a_rig_is_a_glb_with_a_shape_for_each_name(tmp_path: Path) -> None:
    file = head().read(tmp_path)
    with pytest.raises(MeshError, match=r"the suffix of a rig must be \.glb"):
        write_rig(tmp_path / "rig.gltf", file, ["x"], file.mesh.vertices[None])
    with pytest.raises(MeshError, match=r"shapes must be \(2, 81, 3\) for these names, got \(1, 81, 3\)"):
        write_rig(tmp_path / "rig.glb", file, ["x", "y"], file.mesh.vertices[None])
    with pytest.raises(MeshError, match="shapes must be finite"):
        write_rig(tmp_path / "rig.glb", file, ["x"], file.mesh.vertices[None] * np.nan)
    assert not (tmp_path / "rig.glb").exists()


@pytest.mark.parametrize("count", [0, 1, 30, SIDE2])
def test_morph_targets_hold_only_what_moves(count: int, tmp_path: Path) -> None:
    target = targets(tmp_path, ".glb")
    shape = target.mesh.vertices.copy()
    shape[:count] += ways()["jawOpen 1"][:count]
    write_rig(tmp_path / "rig.glb", target, ["a", "b"], np.stack([shape, target.mesh.vertices + 1]))
    held = document(tmp_path / "rig.glb")
    accessor = held["accessors"][held["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]]
    assert ("sparse" in accessor) == (count < SIDE2)
    made = read_rig(tmp_path / "rig.glb").shapes[0]
    assert_allclose(made, shape, atol=1e-6)
    index = held["accessors"].index(accessor)
    values = GltfContainer.read((tmp_path / "rig.glb").read_bytes(), tmp_path).read_accessor(index)
    assert_array_equal([accessor["min"], accessor["max"]], [values.min(0), values.max(0)])


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_a_rig_is_scaled_as_a_whole(suffix: str, tmp_path: Path) -> None:
    target = targets(tmp_path, suffix)
    shapes = target.mesh.vertices + np.stack(list(ways().values()))
    write_rig(tmp_path / "rig.glb", target, list(ways()), shapes, 0.01)
    rig = read_rig(tmp_path / "rig.glb")
    assert_allclose(rig.file.mesh.vertices, target.mesh.vertices / 100, atol=1e-7)
    assert_allclose(rig.shapes, shapes / 100, atol=1e-7)
    seen = trimesh.load(tmp_path / "rig.glb", process=False)
    assert_allclose(seen.bounds * 100, [target.mesh.vertices.min(0), target.mesh.vertices.max(0)], atol=1e-4)


@pytest.mark.parametrize("normals", ["", "out", "in"])
def test_a_rig_made_of_a_rig_that_is_inside_out_is_wound_right(normals: str, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(2)
    made = Glb()
    mesh = made.mesh(ball.vertices, ball.faces[:, ::-1])
    attributes = made.json["meshes"][mesh]["primitives"][0]["attributes"]
    if normals == "":
        del attributes["NORMAL"]
    else:
        attributes["NORMAL"] = made.accessor(ball.vertices * (1 if normals == "out" else -1))
    made.node(mesh=mesh)
    file = made.read(tmp_path)
    assert len(file.notes) == 1
    write_rig(tmp_path / "rig.glb", file, ["grown"], file.mesh.vertices[None] * 1.5)
    again = read_rig(tmp_path / "rig.glb")
    assert not again.file.notes
    assert_allclose(again.shapes[0], again.file.mesh.vertices * 1.5, atol=1e-6)
    if again.file.document.normals is not None:
        assert ((again.file.document.normals * again.file.document.vertices).sum(1) > 0.9).all()


@pytest.mark.parametrize("normals", ["", "out", "in"])
def test_a_rig_made_of_a_file_that_is_inside_out_is_wound_right(normals: str, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(2)
    lines = [f"v {-x} {y} {z}" for x, y, z in ball.vertices]
    side = -1 if normals == "in" else 1
    lines += [f"vn {-x * side} {y * side} {z * side}" for x, y, z in ball.vertices if normals]
    lines += [
        "f " + " ".join(f"{k + 1}//{k + 1}" if normals else f"{k + 1}" for k in face) for face in ball.faces
    ]
    (tmp_path / "ball.obj").write_text("\n".join(lines))
    file = read_mesh(tmp_path / "ball.obj")
    assert len(file.notes) == 1
    write_rig(tmp_path / "rig.glb", file, ["grown"], file.mesh.vertices[None] * 1.5)
    made = read_mesh(tmp_path / "rig.glb")
    assert not made.notes
    assert made.document.normals is not None
    assert ((made.document.normals * made.document.vertices).sum(1) > 0.9).all()
