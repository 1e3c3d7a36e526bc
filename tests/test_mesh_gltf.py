"""glTF and GLB of all kinds, read and written by ourselves and by trimesh."""

import base64
import copy
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from test_mesh import grid, sheet, slit

from guise.analogy.formats.files import MeshFile, read_mesh, read_rig, write_rig
from guise.analogy.formats.gltf import GltfDocument
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import MeshError
from guise.analogy.normals import polygon_vertex_normals
from guise.common.arrays import F64, Int

Json = dict[str, Any]

KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
SIDE2 = 81
TRIANGLES = np.concatenate([grid()[:, [0, 1, 2]], grid()[:, [0, 2, 3]]])


class Glb:
    """A GLB put together by hand."""

    def __init__(self) -> None:
        self.json: Json = {
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "bufferViews": [],
            "accessors": [],
            "buffers": [{}],
        }
        self.buffer = b""

    def view(self, values: NDArray[Any]) -> int:
        self.json["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.buffer), "byteLength": values.nbytes}
        )
        self.buffer += values.tobytes() + bytes(-values.nbytes % 4)
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: NDArray[Any], kind: str = "f4", **more: Any) -> int:
        held = np.asarray(values, "<" + kind).reshape(len(values), -1)
        made = {"bufferView": self.view(held), "componentType": KINDS[kind], "count": len(held)}
        self.json["accessors"].append(
            {**made, "type": WIDTHS[held.shape[1]], "min": held.min(0).tolist(), "max": held.max(0).tolist()}
            | more
        )
        return len(self.json["accessors"]) - 1

    def mesh(self, vertices: F64, triangles: Int, targets: dict[str, F64] | None = None) -> int:
        attributes = {
            "POSITION": self.accessor(vertices),
            "NORMAL": self.accessor(polygon_vertex_normals(vertices, Polygons.of(triangles))),
        }
        primitive: Json = {"attributes": attributes, "indices": self.accessor(triangles.ravel(), "u2")}
        made: Json = {"primitives": [primitive]}
        if targets:
            primitive["targets"] = [{"POSITION": self.accessor(way)} for way in targets.values()]
            made["extras"] = {"targetNames": list(targets)}
        self.json["meshes"].append(made)
        return len(self.json["meshes"]) - 1

    def node(self, **node: Any) -> int:
        self.json["nodes"].append(copy.deepcopy(node))
        self.json["scenes"][0]["nodes"].append(len(self.json["nodes"]) - 1)
        return len(self.json["nodes"]) - 1

    def data(self) -> bytes:
        self.json["buffers"][0]["byteLength"] = len(self.buffer)
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self.buffer), 0x004E4942) + self.buffer
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    def read(self, tmp_path: Path) -> MeshFile:
        (tmp_path / "made.glb").write_bytes(self.data())
        return read_mesh(tmp_path / "made.glb")


def ways(count: int = 3) -> dict[str, F64]:
    """Displacements of the sheet, by name; whole 64ths, which float32 holds."""
    generator = np.random.default_rng(1)
    return {f"jawOpen {k}": generator.integers(-32, 32, (SIDE2, 3)) / 64 for k in range(count)}


def head(targets: dict[str, F64] | None = None, **node: Any) -> Glb:
    made = Glb()
    made.node(mesh=made.mesh(sheet(), TRIANGLES, targets), **node)
    return made


def document(path: Path) -> Json:
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    return dict(json.loads(data[20 : 20 + length]))


PLACED = {"translation": [1.0, 2, 3], "rotation": [0.0, 0.6, 0, 0.8], "scale": [2.0, 2, 2]}


def gathered(scene: Any) -> F64:
    """The vertices of all meshes of a trimesh scene, by the meshes' names."""
    meshes = sorted(scene.dump(), key=lambda mesh: str(mesh.metadata["name"]))
    return np.concatenate([mesh.vertices for mesh in meshes])


def test_a_glb_of_another_program_goes_through(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    ball = trimesh.creation.icosphere(2)
    assert len(ball.vertex_normals)
    scene.add_geometry(ball, transform=trimesh.transformations.rotation_matrix(0.5, [1, 2, 3], [0, 1, 0]))
    box = trimesh.creation.box((1, 2, 3))
    box.visual.vertex_colors = [255, 0, 0, 255]
    scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    scene.export(tmp_path / "a.glb")
    file = read_mesh(tmp_path / "a.glb")
    assert_allclose(file.mesh.vertices, gathered(scene), atol=1e-6)
    file.write(tmp_path / "b.glb", file.mesh.vertices)
    assert (tmp_path / "b.glb").read_bytes() == (tmp_path / "a.glb").read_bytes()
    file.write(tmp_path / "c.glb", file.mesh.vertices @ np.diag([1.0, 2, 1]))
    stretched = trimesh.load(tmp_path / "c.glb", process=False)
    assert_allclose(gathered(stretched), file.mesh.vertices * (1, 2, 1), atol=1e-5)
    assert_allclose(stretched.bounds, scene.bounds * (1, 2, 1), atol=1e-5)
    assert set(stretched.geometry) == set(scene.geometry)
    before, after = document(tmp_path / "a.glb"), document(tmp_path / "c.glb")
    assert {**before, "accessors": 0} == {**after, "accessors": 0}


@pytest.mark.parametrize(
    "node",
    [
        {},
        PLACED,
        {"scale": [-1.0, 1, 1]},
        {"matrix": [0.0, 0, 3, 0, 0, 2, 0, 0, -1, 0, 0, 0, 7, 8, 9, 1]},
    ],
)
def test_nodes_place_their_meshes(node: Json, tmp_path: Path) -> None:
    """As trimesh places them; normals look out of the faces; written back to where they were."""
    made = head(**node)
    above = made.node(translation=[0.0, 0, 10], children=[0])
    made.json["scenes"][0]["nodes"] = [above]
    file = made.read(tmp_path)
    (seen,) = trimesh.load(file.path, process=False).dump()
    assert_allclose(file.mesh.vertices, seen.vertices, atol=1e-5)
    faces = Polygons.of(file.mesh.triangles).area_vectors(file.mesh.vertices)
    normals = file.document.normals
    assert normals is not None
    assert (np.einsum("ij,ikj->ik", faces, normals[file.mesh.triangles]) > 0).all()
    bent = file.mesh.vertices + 0.1 * file.mesh.vertices[:, :1] ** 2
    file.write(tmp_path / "bent.glb", bent)
    back = read_mesh(tmp_path / "bent.glb")
    assert_allclose(back.mesh.vertices, bent, rtol=1e-6, atol=1e-6)
    wanted = polygon_vertex_normals(bent, Polygons.of(file.mesh.triangles))
    assert back.document.normals is not None
    assert float(np.abs((back.document.normals * wanted).sum(1)).min()) > 0.95


def test_a_seam_of_a_glb_is_closed_and_written_to_both_sides(tmp_path: Path) -> None:
    vertices, quads, origin = slit(sheet(), grid())
    made = Glb()
    mesh = made.mesh(vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    uvs = np.arange(2.0 * len(vertices)).reshape(-1, 2)
    whole = polygon_vertex_normals(sheet(), Polygons.of(TRIANGLES))[origin]
    more = {"TEXCOORD_0": made.accessor(uvs), "NORMAL": made.accessor(whole)}
    made.json["meshes"][mesh]["primitives"][0]["attributes"] |= more
    made.node(mesh=mesh)
    file = made.read(tmp_path)
    assert_allclose(file.mesh.vertices, sheet(), atol=1e-7)
    bent = file.mesh.vertices + file.mesh.vertices**2
    file.write(tmp_path / "bent.glb", bent)
    written = GltfDocument((tmp_path / "bent.glb").read_bytes(), tmp_path)
    assert_allclose(written.vertices, bent[origin], atol=1e-6)
    assert written.normals is not None
    assert_array_equal(written.normals[SIDE2:], written.normals[origin[SIDE2:]])
    assert_array_equal(written.uvs, uvs)


def test_parts_of_several_materials_are_one_surface(tmp_path: Path) -> None:
    """Their vertices along the border between them are the same, texture coordinates and all."""
    made, upper = Glb(), (TRIANGLES >= SIDE2 // 2 - 4).all(axis=1)
    whole, primitives = polygon_vertex_normals(sheet(), Polygons.of(TRIANGLES)), []
    for chosen in (TRIANGLES[upper], TRIANGLES[~upper]):
        used, triangles = np.unique(chosen, return_inverse=True)
        values = {"POSITION": sheet()[used], "NORMAL": whole[used], "TEXCOORD_0": sheet()[used, :2]}
        attributes = {name: made.accessor(held) for name, held in values.items()}
        primitives.append({"attributes": attributes, "indices": made.accessor(triangles.ravel(), "u2")})
    made.json["meshes"] = [{"primitives": primitives}]
    made.node(mesh=0)
    file = made.read(tmp_path)
    assert len(file.document.vertices) == SIDE2 + 9
    assert len(file.mesh.vertices) == SIDE2
    assert file.mesh.components.max() == 0


def test_numbers_of_all_kinds_are_read(tmp_path: Path) -> None:
    """Whole, normalised, interleaved and sparse."""
    made = head(ways(2))
    primitive = made.json["meshes"][0]["primitives"][0]
    steps = np.rint(sheet() * 1000)
    primitive["attributes"]["POSITION"] = made.accessor(steps, "i2")
    primitive["attributes"]["NORMAL"] = made.accessor(np.tile([0, 0, 127], (SIDE2, 1)), "i1", normalized=True)
    first, second = primitive["targets"]
    made.json["accessors"][first["POSITION"]].pop("bufferView")
    rows = np.array([3, 5, 80])
    made.json["accessors"][first["POSITION"]]["sparse"] = {
        "count": 3,
        "indices": {"bufferView": made.view(rows.astype("<u2")), "componentType": KINDS["u2"]},
        "values": {"bufferView": made.view(np.full((3, 3), 7, "<f4"))},
    }
    both = np.concatenate([ways()["jawOpen 1"], ways()["jawOpen 0"]], axis=1).astype("<f4")
    made.json["accessors"][second["POSITION"]] |= {"bufferView": made.view(both), "byteOffset": 12}
    made.json["bufferViews"][-1]["byteStride"] = 24
    made.json["extensionsRequired"] = made.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    file = made.read(tmp_path)
    assert_array_equal(file.mesh.vertices, steps)
    assert_array_equal(file.document.normals, np.tile([0, 0, 1], (SIDE2, 1)))
    rig = read_rig(file.path)
    sparse = np.zeros((SIDE2, 3))
    sparse[rows] = 7
    assert_array_equal(rig.shapes - steps, [sparse, ways()["jawOpen 0"]])
    file.write(tmp_path / "moved.glb", steps + 0.25)
    assert_array_equal(read_mesh(tmp_path / "moved.glb").mesh.vertices, steps + 0.25)


def skinned(held: Glb, weights: F64) -> Glb:
    """With two joints at rest in a scaled skeleton, by weights (n, 2)."""
    held.node(translation=[0.0, 1, 0], children=[2], scale=[0.01, 0.01, 0.01])
    held.json["nodes"].append({"translation": [0.0, 50, 0]})
    binds = np.stack([np.eye(4), np.eye(4)])
    binds[0][1, 3], binds[1][1, 3] = -1, -1.5
    binds = np.linalg.inv(np.diag([0.01, 0.01, 0.01, 1])) @ binds
    bind = held.accessor(binds.transpose(0, 2, 1).reshape(2, 16))
    held.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": bind}]
    four = np.pad(weights, ((0, 0), (0, 2)))
    held.json["meshes"][0]["primitives"][0]["attributes"] |= {
        "JOINTS_0": held.accessor(np.tile([0, 1, 0, 0], (SIDE2, 1)), "u1"),
        "WEIGHTS_0": held.accessor(four),
    }
    return held


def test_a_skinned_mesh_stands_as_its_main_joint_puts_it(tmp_path: Path) -> None:
    """Joints at rest undo what the nodes above do; a pose of other joints does not matter, as in an avatar's arms."""
    weights = np.tile([0.9, 0.1], (SIDE2, 1))
    weights[:5] = [0, 1]
    made = skinned(head({"smile": ways()["jawOpen 0"]}, skin=0, **PLACED), weights)
    assert_allclose(made.read(tmp_path).mesh.vertices, sheet(), atol=1e-6)
    made.json["nodes"][2]["rotation"] = PLACED["rotation"]
    file = made.read(tmp_path)
    assert_allclose(file.mesh.vertices, sheet(), atol=1e-6)
    write_rig(tmp_path / "rig.glb", file, ["smile"], file.mesh.vertices[None] + ways()["jawOpen 0"])
    assert_allclose(read_rig(tmp_path / "rig.glb").shapes[0] - sheet(), ways()["jawOpen 0"], atol=1e-6)
    made.json["nodes"][1]["translation"] = [0.0, 1.5, 0]
    assert_allclose(made.read(tmp_path).mesh.vertices, sheet() + np.array([0, 0.5, 0]), atol=1e-6)


def test_a_gltf_with_its_files(tmp_path: Path) -> None:
    """Its buffer is put into what is written, its picture goes along; a rig holds both."""
    made = head()
    made.json["buffers"][0] |= {"uri": "my%20data.bin", "byteLength": len(made.buffer)}
    made.json["images"] = [{"uri": "maps/skin.jpg"}]
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "skin.jpg").write_bytes(b"\xff\xd8\xff0")
    (tmp_path / "my data.bin").write_bytes(made.buffer)
    (tmp_path / "a.gltf").write_text(json.dumps(made.json))
    file = read_mesh(tmp_path / "a.gltf")
    file.write(tmp_path / "out" / "b.gltf", file.mesh.vertices + 1)
    assert_allclose(read_mesh(tmp_path / "out" / "b.gltf").mesh.vertices, sheet() + 1, atol=1e-6)
    assert (tmp_path / "out" / "maps" / "skin.jpg").is_file()
    write_rig(tmp_path / "rig.glb", file, ["x"], file.mesh.vertices[None] + 1)
    rig = document(tmp_path / "rig.glb")
    assert rig["images"] == [{"bufferView": len(rig["bufferViews"]) - 1, "mimeType": "image/jpeg"}]
    (tmp_path / "my data.bin").unlink()
    with pytest.raises(MeshError, match=r"it names the file my%20data\.bin, which is not in"):
        read_mesh(tmp_path / "a.gltf")


def spoilt(change: Any) -> bytes:
    made = head(ways(1))
    change(made)
    return made.data()


def with_nan() -> bytes:
    made = head({"smile": np.full((SIDE2, 3), np.nan)})
    made.json["accessors"][-1]["min"] = made.json["accessors"][-1]["max"] = [0, 0, 0]
    return made.data()


BAD = {
    "a target": (with_nan(), "its morph target smile is not finite"),
    "no json": (b"glTF" + bytes(60), "no JSON"),
    "text": (b"hello", "no JSON"),
    "old": (spoilt(lambda g: g.json["asset"].update(version="1.0")), "it is glTF 1.0, but only 2.0 is read"),
    "strips": (spoilt(lambda g: g.json["meshes"][0]["primitives"][0].update(mode=5)), "strips or fans"),
    "lines": (spoilt(lambda g: g.json["meshes"][0]["primitives"][0].update(mode=1)), "no vertices"),
    "twice": (spoilt(lambda g: g.node(mesh=0)), "its mesh 0 occurs in the scene more than once"),
    "flat": (
        spoilt(lambda g: g.json["nodes"][0].update(scale=[1, 0, 1], name="eye")),
        "node eye is scaled to zero",
    ),
    "no scene": (spoilt(lambda g: g.json["scenes"][0].update(nodes=[])), "no vertices"),
    "a face": (
        spoilt(lambda g: g.json["accessors"][0].update(count=40)),
        "vertex 80, but its part has 40",
    ),
    "a view": (spoilt(lambda g: g.json["bufferViews"].clear()), "its glTF document is damaged"),
    "a buffer": (spoilt(lambda g: g.json["accessors"][0].update(byteOffset=10**6)), "its buffer ends before"),
    "half": (head().data()[:-100], "it ends too early"),
    "nan": (
        spoilt(lambda g: setattr(g, "buffer", b"\xff" * 972 + g.buffer[972:])),
        "81 of its 81 vertices are not finite",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_glb_is_said_in_a_sentence(name: str, tmp_path: Path) -> None:
    data, said = BAD[name]
    (tmp_path / "bad.glb").write_bytes(data)
    with pytest.raises(MeshError, match=rf"^cannot use .*bad\.glb: .*{said}"):
        read_mesh(tmp_path / "bad.glb")


def test_data_in_an_address_is_read(tmp_path: Path) -> None:
    made = head()
    address = "data:application/octet-stream;base64," + base64.b64encode(made.buffer).decode()
    made.json["buffers"] = [{"byteLength": len(made.buffer), "uri": address}]
    (tmp_path / "a.gltf").write_text(json.dumps(made.json))
    assert_allclose(read_mesh(tmp_path / "a.gltf").mesh.vertices, sheet(), atol=1e-7)


@given(st.lists(st.sampled_from(["anger", "anger_2", "anger_3", "", "smile", "target_01"]), min_size=1, max_size=7),
       st.sampled_from(["mesh", "primitive", "both"]))  # fmt: skip
def test_every_morph_target_keeps_its_motion_and_has_a_name_of_its_own(names: list[str], where: str) -> None:
    """However often a name occurs, and whether the mesh or its primitive names them."""
    moves = [np.full((SIDE2, 3), k + 1.0) for k in range(len(names))]
    made = head({f"{k}": move for k, move in enumerate(moves)})
    mesh = made.json["meshes"][0]
    mesh["extras"] = {"targetNames": names} if where != "primitive" else "not an object"
    if where != "mesh":
        mesh["primitives"][0]["extras"] = {"targetNames": names if where == "primitive" else ["wrong"]}
    held = GltfDocument(made.data(), Path())
    assert len(held.displacements) == len(names)
    for move, own in zip(moves, held.displacements.values(), strict=True):
        assert_array_equal(own, move)
    firsts = {name for name in names if name}
    assert firsts <= set(held.displacements)
    assert held.repeated_names == [name for name in dict.fromkeys(names) if name and names.count(name) > 1]


def test_a_rig_forgets_names_in_primitives(tmp_path: Path) -> None:
    made = head(ways(2))
    made.json["meshes"][0]["primitives"][0]["extras"] = made.json["meshes"][0].pop("extras")
    file = made.read(tmp_path)
    assert read_rig(file.path).names == tuple(ways(2))
    write_rig(tmp_path / "rig.glb", file, ["smile"], file.mesh.vertices[None] + 1)
    assert read_rig(tmp_path / "rig.glb").names == ("smile",)
    assert "jawOpen" not in str(document(tmp_path / "rig.glb"))
