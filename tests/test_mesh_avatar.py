"""An avatar as Ready Player Me exports it: head, teeth, eyes and body on one skeleton, whose arms are posed."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from test_mesh_gltf import KINDS, Glb, Json, document

from guise.analogy.formats.files import read_mesh, read_rig, write_rig
from guise.analogy.formats.gltf_container import ELEMENT_WIDTHS, GltfContainer
from guise.analogy.transfer import prepare_transfer
from guise.common.arrays import F64, Int

HEADS = Path(__file__).parents[1] / "sample_videos" / "heads"
SHAPES = 52
# Joint, parent, translation in metres.
JOINTS = [
    ("Hips", -1, (0, 1.0, 0)), ("Spine", 0, (0, 0.2, 0)), ("Neck", 1, (0, 0.3, 0)), ("Head", 2, (0, 0.1, 0)),
    ("LeftArm", 1, (0.2, 0.2, 0)), ("RightArm", 1, (-0.2, 0.2, 0)),
]  # fmt: skip
ARM_TURNS = {"LeftArm": (0.0, 0.0, -0.5, 0.75**0.5), "RightArm": (0.0, 0.0, 0.5, 0.75**0.5)}


def places() -> F64:
    """Joints (j, 3) in the bind pose, in the scene."""
    out: list[F64] = []
    for _, parent, shift in JOINTS:
        out.append(np.array(shift) + (out[parent] if parent >= 0 else 0))
    return np.array(out)


class Avatar(Glb):
    """A skeleton and the meshes that it moves."""

    def __init__(self) -> None:
        super().__init__()
        self.json["nodes"] = [
            {
                "name": name,
                "translation": list(map(float, shift)),
                **({"rotation": list(ARM_TURNS[name])} if name in ARM_TURNS else {}),
            }
            for name, _, shift in JOINTS
        ]
        for number, (_, parent, _) in enumerate(JOINTS):
            if parent >= 0:
                self.json["nodes"][parent].setdefault("children", []).append(number)
        binds = np.tile(np.eye(4), (len(JOINTS), 1, 1))
        binds[:, :3, 3] = -places()
        inverse = self.accessor(binds.transpose(0, 2, 1).reshape(-1, 16))
        self.json["skins"] = [{"joints": list(range(len(JOINTS))), "inverseBindMatrices": inverse}]
        self.json["nodes"].append({"name": "Armature", "children": [0]})
        self.json["scenes"][0]["nodes"] = [len(JOINTS)]
        self.json["scene"] = 0

    def part(self, name: str, vertices: F64, triangles: Int, joints: Int) -> None:
        """A mesh whose vertices follow one joint (n,) each."""
        number = self.mesh(vertices, triangles)
        ids, weights = np.zeros((len(vertices), 4)), np.zeros((len(vertices), 4))
        ids[:, 0], weights[:, 0] = joints, 1
        held = self.json["meshes"][number]
        held["name"] = name
        held["primitives"][0]["attributes"] |= {
            "JOINTS_0": self.accessor(ids, "u1"),
            "WEIGHTS_0": self.accessor(weights),
        }
        self.json["nodes"].append({"name": name, "mesh": number, "skin": 0})
        self.json["nodes"][len(JOINTS)]["children"].append(len(self.json["nodes"]) - 1)


def box(middle: F64, size: tuple[float, float, float]) -> tuple[F64, Int]:
    made = trimesh.creation.box(size)
    return made.vertices + middle, made.faces


def avatar() -> tuple[Avatar, F64, int]:
    """The avatar, its head in the bind pose, and how many vertices come before the head's."""
    head = read_mesh(HEADS / "other.obj").mesh
    low, high = head.vertices.min(0), head.vertices.max(0)
    scale = 0.28 / (high[1] - low[1])
    placed = (head.vertices - (low + high) / 2) * scale + places()[3] + (0, 0.08, 0.02)
    made = Avatar()
    made.part("Wolf3D_Head", placed, head.faces, np.full(len(placed), 3))
    for name, joint in (("LeftArm", 4), ("RightArm", 5), ("Spine", 1)):
        vertices, triangles = box(places()[joint], (0.1, 0.3, 0.1))
        made.part(f"Wolf3D_{name}", vertices, triangles, np.full(len(vertices), joint))
    return made, placed, 0


def problems(path: Path) -> list[str]:
    """What of a GLB disagrees with glTF 2.0: sizes, alignment, bounds, sparse rows, morph targets, references."""
    data = path.read_bytes()
    length, chunk = len(data), struct.unpack_from("<I", data, 12)[0]
    held, found = document(path), []
    container = GltfContainer.read(data, path.parent)
    if struct.unpack_from("<I", data, 8)[0] != length or chunk % 4 or (length - chunk - 28) % 4:
        found.append("lengths of the file and its chunks")
    if held["buffers"][0]["byteLength"] > length - chunk - 28:
        found.append("length of the buffer")
    for number, view in enumerate(held["bufferViews"]):
        if view.get("byteOffset", 0) + view["byteLength"] > held["buffers"][0]["byteLength"]:
            found.append(f"view {number} ends beyond the buffer")
    sizes = {number: np.dtype(kind).itemsize for kind, number in KINDS.items()}
    for number, accessor in enumerate(held["accessors"]):
        found += [
            f"accessor {number}: {said}"
            for said in accessor_problems(held, container, number, accessor, sizes)
        ]
    for mesh in held["meshes"]:
        counts = {len(primitive.get("targets", [])) for primitive in mesh["primitives"]}
        named = len((mesh.get("extras") or {}).get("targetNames", []))
        if len(counts) > 1 or counts != {named} or len(mesh.get("weights", [0] * named)) != named:
            found.append(f"targets of {mesh.get('name')}")
        for primitive in mesh["primitives"]:
            own = held["accessors"][primitive["attributes"]["POSITION"]]["count"]
            ids = [
                *primitive["attributes"].values(),
                *(k for t in primitive.get("targets", []) for k in t.values()),
            ]
            if any(held["accessors"][k]["count"] != own for k in ids):
                found.append(f"counts of {mesh.get('name')}")
            if container.read_accessor(primitive["indices"]).max() >= own:
                found.append(f"indices of {mesh.get('name')}")
    return found


def accessor_problems(
    held: Json, container: GltfContainer, number: int, accessor: Json, sizes: dict[int, int]
) -> list[str]:
    found, values = [], container.read_accessor(number)
    width = ELEMENT_WIDTHS[accessor["type"]]
    for name, best in (("min", values.min(0)), ("max", values.max(0))):
        if name in accessor and not np.allclose(accessor[name], best, rtol=1e-6, atol=1e-12):
            found.append(f"{name} is {accessor[name]}, should be {best.tolist()}")
    if "bufferView" in accessor:
        view = held["bufferViews"][accessor["bufferView"]]
        step = sizes[accessor["componentType"]]
        if (view.get("byteOffset", 0) + accessor.get("byteOffset", 0)) % step:
            found.append("is not aligned")
        if accessor["count"] * width * step > view["byteLength"]:
            found.append("is longer than its view")
    if "sparse" in accessor:
        sparse = accessor["sparse"]
        view = held["bufferViews"][sparse["indices"]["bufferView"]]
        kind = "<u2" if sparse["indices"]["componentType"] == KINDS["u2"] else "<u4"
        rows = np.frombuffer(container.buffer, kind, sparse["count"], view["byteOffset"]).astype(int)
        if (np.diff(rows) <= 0).any() or rows.max() >= accessor["count"] or len(rows) > accessor["count"]:
            found.append("its sparse rows do not ascend")
        if "target" in view:
            found.append("its sparse rows have a target")
    return found


def shapes(source: F64) -> dict[str, F64]:
    """52 expressions: shares of a smile and a surprise."""
    mean = read_mesh(HEADS / "mean.obj")
    ways = [mean.read_expression(HEADS / f"mean_{name}.obj") - source for name in ("smile", "surprise")]
    angles = np.linspace(0, np.pi / 2, SHAPES)
    return {
        f"shape {k:02d}": source + np.cos(a) * ways[0] + np.sin(a) * ways[1] for k, a in enumerate(angles)
    }


@pytest.mark.slow
def test_an_avatar_with_posed_arms_gets_52_shapes(tmp_path: Path) -> None:
    made, bind, start = avatar()
    (tmp_path / "avatar.glb").write_bytes(made.data())
    assert problems(tmp_path / "avatar.glb") == []
    target = read_mesh(tmp_path / "avatar.glb")
    head = slice(start, start + len(bind))
    assert_allclose(target.document.vertices[head], bind, atol=1e-5)
    source = read_mesh(HEADS / "mean.obj").mesh
    transfer = prepare_transfer(source, target.mesh)
    wanted = {name: transfer(shape) for name, shape in shapes(source.vertices).items()}
    write_rig(tmp_path / "rig.glb", target, list(wanted), np.stack(list(wanted.values())))
    assert problems(tmp_path / "rig.glb") == []
    rig = read_rig(tmp_path / "rig.glb")
    assert rig.names == tuple(wanted)
    assert_allclose(rig.shapes, np.stack(list(wanted.values())), atol=5e-5)
    before, after = document(tmp_path / "avatar.glb"), document(tmp_path / "rig.glb")
    assert after["skins"] == before["skins"]
    assert after["nodes"] == before["nodes"]
    assert ["targets" in mesh["primitives"][0] for mesh in after["meshes"]] == [True, False, False, False]
    moved = np.linalg.norm(rig.shapes - rig.file.mesh.vertices, axis=2).max(1)
    assert (moved > 0.002).all()  # metres
    assert (moved < 0.05).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda held: held["accessors"][1].update(max=[9, 9, 9]), "max is"),
        (lambda held: held["bufferViews"][0].update(byteLength=10**9), "ends beyond the buffer"),
        (lambda held: held["meshes"][0].update(weights=[0.0, 1.0]), "targets of"),
        (lambda held: held["meshes"][0]["primitives"][0]["attributes"].update(NORMAL=0), "counts of"),
    ],
)
def test_the_check_of_avatars_finds_faults(change: Any, said: str, tmp_path: Path) -> None:
    made = avatar()[0]
    text = json.loads(json.dumps(made.json))
    change(text)
    made.json = text
    (tmp_path / "bad.glb").write_bytes(made.data())
    assert any(said in found for found in problems(tmp_path / "bad.glb"))
