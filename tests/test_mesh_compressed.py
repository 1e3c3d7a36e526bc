"""Compressed glTF: Draco and meshopt, expanded by their libraries."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from test_mesh import sheet
from test_mesh_gltf import SIDE2, TRIANGLES, Glb, document, head, ways

from guise.analogy.formats.files import read_mesh, read_rig, write_rig
from guise.analogy.formats.gltf_container import GltfContainer
from guise.analogy.mesh import MeshError

DRACO, MESHOPT = "KHR_draco_mesh_compression", "EXT_meshopt_compression"
LIBRARIES = {DRACO: "DracoPy", MESHOPT: "meshoptimizer"}


def with_draco(made: Glb) -> Glb:
    """Its only primitive, in the order of Draco, which the morph targets of a file follow too."""
    draco = pytest.importorskip("DracoPy")
    numbers = np.arange(SIDE2 * 4, dtype=np.uint16).reshape(-1, 4)
    data = draco.encode(
        sheet(), TRIANGLES.astype(np.uint32), quantization_bits=20, preserve_order=True, generic_attributes={7: numbers}
    )  # fmt: skip
    (place,) = (held["unique_id"] for held in draco.decode(data).attributes if held["unique_id"] != 7)
    primitive = made.json["meshes"][0]["primitives"][0]
    primitive["attributes"]["JOINTS_0"] = made.accessor(np.zeros((SIDE2, 4)), "u2")
    for accessor in (
        primitive["indices"],
        *(primitive["attributes"][name] for name in ("POSITION", "JOINTS_0")),
    ):
        del made.json["accessors"][accessor]["bufferView"]
    view = made.view(np.frombuffer(data, np.uint8))
    primitive["extensions"] = {DRACO: {"bufferView": view, "attributes": {"POSITION": place, "JOINTS_0": 7}}}
    made.json["extensionsUsed"] = made.json["extensionsRequired"] = [DRACO]
    return made


def with_meshopt(made: Glb) -> Glb:
    """All of its buffer views; the one buffer becomes a second, compressed one."""
    meshopt = pytest.importorskip("meshoptimizer")
    triangles = made.json["meshes"][0]["primitives"][0]["indices"]
    whole, packed = made.buffer, b""
    for accessor in made.json["accessors"]:
        view = made.json["bufferViews"][accessor["bufferView"]]
        values = whole[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        if accessor is made.json["accessors"][triangles]:
            stride, mode = 2, "TRIANGLES"
            data = meshopt.encode_index_buffer(TRIANGLES.ravel().astype(np.uint32), TRIANGLES.size, SIDE2)
        else:
            stride, mode = 12, "ATTRIBUTES"
            data = meshopt.encode_vertex_buffer(np.frombuffer(values, np.float32).reshape(-1, 3), SIDE2, 12)
        held = {"buffer": 1, "byteOffset": len(packed), "byteLength": len(data), "byteStride": stride}
        view["extensions"] = {
            MESHOPT: {**held, "count": len(values) // stride, "mode": mode, "filter": "NONE"}
        }
        packed += bytes(data) + bytes(-len(data) % 4)
    fallback = {"byteLength": len(whole), "extensions": {MESHOPT: {"fallback": True}}}
    made.json["buffers"] = [fallback, {"byteLength": len(packed)}]
    made.json["extensionsUsed"] = made.json["extensionsRequired"] = [MESHOPT]
    made.buffer = packed
    return made


def data(made: Glb) -> bytes:
    """A GLB; its binary chunk is the last buffer."""
    buffers = [dict(held) for held in made.json["buffers"]]
    out = made.data()
    made.json["buffers"] = buffers
    return out


PACKED = {DRACO: with_draco, MESHOPT: with_meshopt}


@pytest.mark.parametrize("name", PACKED)
def test_a_compressed_rig_is_read(name: str, tmp_path: Path) -> None:
    path = tmp_path / "packed.glb"
    path.write_bytes(data(PACKED[name](head(ways(2)))))
    rig = read_rig(path)
    assert_allclose(rig.file.mesh.vertices, sheet(), atol=1e-5)
    assert_array_equal(np.sort(rig.file.mesh.faces, axis=None), np.sort(TRIANGLES, axis=None))
    assert_allclose(rig.shapes - rig.file.mesh.vertices, np.stack(list(ways(2).values())), atol=1e-6)


@pytest.mark.parametrize("name", PACKED)
def test_what_is_written_is_not_compressed(name: str, tmp_path: Path) -> None:
    path = tmp_path / "packed.glb"
    path.write_bytes(data(PACKED[name](head(ways(1)))))
    file = read_mesh(path)
    write_rig(tmp_path / "rig.glb", file, ["smile"], file.mesh.vertices[None] + 1)
    file.write(tmp_path / "moved.glb", file.mesh.vertices + 1)
    for made in (tmp_path / "rig.glb", tmp_path / "moved.glb"):
        assert name not in str(document(made))
        assert "extensionsRequired" not in document(made)
    assert_allclose(read_mesh(tmp_path / "moved.glb").mesh.vertices, sheet() + 1, atol=1e-5)


@pytest.mark.parametrize("stride", [4, 8])
def test_meshopt_filters_are_undone(stride: int, tmp_path: Path) -> None:
    """Octahedral normals of 8 and 16 bits, as gltfpack writes them: (0, 0, 1) is x = y = 0 beside the largest z."""
    meshopt = pytest.importorskip("meshoptimizer")
    made = with_meshopt(head())
    bits = {4: np.int8, 8: np.int16}[stride]
    stored = np.tile(np.array([0, 0, np.iinfo(bits).max, 0], bits), (SIDE2, 1))
    packed = bytes(meshopt.encode_vertex_buffer(stored.view(np.uint32).reshape(SIDE2, -1), SIDE2, stride))
    normals = made.json["accessors"][made.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]]
    normals |= {"componentType": {4: 5120, 8: 5122}[stride], "normalized": True}
    held = made.json["bufferViews"][normals["bufferView"]]
    held["byteStride"] = stride
    held["extensions"][MESHOPT] |= {
        "byteOffset": len(made.buffer), "byteLength": len(packed), "byteStride": stride, "filter": "OCTAHEDRAL",
    }  # fmt: skip
    made.buffer += packed + bytes(-len(packed) % 4)
    (tmp_path / "a.glb").write_bytes(data(made))
    found = read_mesh(tmp_path / "a.glb").document
    assert_allclose(found.normals, np.tile([0, 0, 1], (SIDE2, 1)), atol=0.01)  # type: ignore[union-attr]


@pytest.mark.parametrize("name", PACKED)
def test_without_the_library_the_extra_is_named(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.glb").write_bytes(data(PACKED[name](head())))
    monkeypatch.setitem(sys.modules, LIBRARIES[name], None)
    with pytest.raises(MeshError, match=r'pip install "guise-video\[compressed\]", or export it without'):
        read_mesh(tmp_path / "a.glb")


def damage(made: Glb, name: str) -> None:
    """Compressed data that are noise, or that name what is not there."""
    if name == DRACO:
        view = made.json["bufferViews"][-1]
        start = view["byteOffset"]
    else:
        start = 0
    noise = bytes(np.random.default_rng(1).integers(0, 255, 200).tolist())
    made.buffer = made.buffer[:start] + noise + made.buffer[start + 200 :]


@pytest.mark.parametrize("name", PACKED)
def test_damaged_compressed_data_are_said_in_a_sentence(name: str, tmp_path: Path) -> None:
    made = PACKED[name](head())
    damage(made, name)
    (tmp_path / "a.glb").write_bytes(data(made))
    with pytest.raises(MeshError, match="compressed data are damaged"):
        read_mesh(tmp_path / "a.glb")


@pytest.mark.parametrize(
    "change",
    [
        lambda held: held.update(count=10**9),
        lambda held: held.pop("byteLength"),
        lambda held: held.update(byteOffset=10**7),
    ],
)
def test_bad_numbers_are_said(change: Any, tmp_path: Path) -> None:
    made = with_meshopt(head())
    change(made.json["bufferViews"][0]["extensions"][MESHOPT])
    (tmp_path / "a.glb").write_bytes(data(made))
    with pytest.raises(MeshError, match="compressed data are damaged"):
        read_mesh(tmp_path / "a.glb")


def test_an_unknown_filter_is_said(tmp_path: Path) -> None:
    made = with_meshopt(head())
    made.json["bufferViews"][0]["extensions"][MESHOPT]["filter"] = "COLOR"
    (tmp_path / "a.glb").write_bytes(data(made))
    with pytest.raises(MeshError, match="with the filter COLOR, which is not known"):
        read_mesh(tmp_path / "a.glb")


def test_a_missing_attribute_of_draco_is_said(tmp_path: Path) -> None:
    made = with_draco(head())
    made.json["meshes"][0]["primitives"][0]["extensions"][DRACO]["attributes"]["POSITION"] = 55
    (tmp_path / "a.glb").write_bytes(data(made))
    with pytest.raises(MeshError, match="POSITION is missing"):
        read_mesh(tmp_path / "a.glb")


def test_bounds_are_those_of_what_was_decoded(tmp_path: Path) -> None:
    """Draco rounds positions; the bounds in the file are those before, or wrong altogether."""
    made = with_draco(head())
    for accessor in made.json["accessors"]:
        accessor["min"], accessor["max"] = ([-7.0] * len(accessor["min"]), [7.0] * len(accessor["max"]))
    (tmp_path / "packed.glb").write_bytes(data(made))
    file = read_mesh(tmp_path / "packed.glb")
    write_rig(tmp_path / "rig.glb", file, ["smile"], file.mesh.vertices[None] + 1)
    held = GltfContainer.read((tmp_path / "rig.glb").read_bytes(), tmp_path)
    primitive = held.json["meshes"][0]["primitives"][0]
    for index in (
        primitive["indices"],
        *(primitive["attributes"][name] for name in ("POSITION", "JOINTS_0")),
    ):
        values, accessor = held.read_accessor(index), held.json["accessors"][index]
        assert_array_equal(accessor["min"], values.min(axis=0))
        assert_array_equal(accessor["max"], values.max(axis=0))
