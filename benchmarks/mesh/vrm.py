"""An avatar as VRM: read, given ARKit's 52 shapes, written as VRM, and read again.

Bodies of `benchmarks.mesh.avatars` in VRoid's layout, with its skeleton, two morph targets and expressions of the
artist, and springs.  Told are names and shapes that come back, what should be still, and what of the file is kept.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.mesh.avatars import NAMES, STILL, Avatar, People
from guise.aam.rig.names import ARKIT_NAMES, coefficient_of
from guise.aam.rig.presets import PRESETS
from guise.analogy.formats.files import read_rig
from guise.analogy.formats.gltf import GltfDocument
from guise.analogy.formats.gltf_container import GL_ARRAY_BUFFER, GL_ELEMENT_ARRAY_BUFFER, GltfContainer
from guise.analogy.formats.humanoid import STANDING, find_bones
from guise.analogy.formats.vrm import LICENSE
from guise.api.heads import transfer_rig
from guise.app.rig.head import shipped_head
from guise.common.arrays import F64

NAME, TITLE = "mesh.vrm", "Avatars as VRM"
METRES_PER_DM, MM_PER_METRE = 0.1, 1000.0
MAX_ROUNDING_MM, MAX_STILL_MM = 0.04, 0.1  # a rig leaves out what moves less than 1e-4 of a part
ARTIST = ("Fcl_ALL_Joy", "Fcl_MTH_A")
VROID_BONES = {"hips": "C_Hips", "spine": "C_Spine", "head": "C_Head"}
SPRING = {"specVersion": "1.0", "springs": [{"name": "hair", "joints": [{"node": 2, "hitRadius": 0.02}]}]}


def vrm_bytes(avatar: Avatar, version: int) -> bytes:
    """An avatar as a VRM of version 0, which looks backwards, or 1."""
    made = GltfContainer({"asset": {"version": "2.0"}, "scene": 0, "nodes": [], "meshes": []}, bytearray())
    turned = METRES_PER_DM * np.array([1, 1, 1] if version else [-1, 1, -1])
    at, ways = avatar.mesh.vertices * turned, avatar.shapes[:2] * turned
    at[:, 1] -= at[:, 1].min()
    _add_skeleton(made, float(np.ptp(at[:, 1])), turned)
    called = NAMES["VRoid"]
    for name in dict.fromkeys(names.split(" / ")[0] for names in called.values()):
        own = {kind: rows for kind, rows in avatar.parts.items() if called[kind].startswith(f"{name} /")}
        _add_mesh(
            made, name, {called[kind].split(" / ")[1]: rows for kind, rows in own.items()}, avatar, at, ways
        )
    nodes = made.json["nodes"]
    made.json["scenes"] = [{"nodes": [0, *(k for k, node in enumerate(nodes) if "mesh" in node)]}]
    face, bones = [node["name"] for node in nodes].index("Face"), find_bones(nodes)
    if version:
        meta = {"name": "body", "authors": ["nobody"], "licenseUrl": LICENSE}
        binds = [{"morphTargetBinds": [{"node": face, "index": k, "weight": 1.0}]} for k in (0, 1)]
        human: Any = {"humanBones": {name: {"node": node} for name, node in bones.items()}}
        told = {
            "meta": meta,
            "humanoid": human,
            "expressions": {"preset": {"happy": binds[0], "aa": binds[1]}},
        }
        made.json["extensions"] = {"VRMC_vrm": {"specVersion": "1.0", **told}, "VRMC_springBone": SPRING}
    else:
        groups = [
            {
                "name": name,
                "presetName": name.lower(),
                "binds": [{"mesh": nodes[face]["mesh"], "index": k, "weight": 100}],
            }
            for k, name in enumerate(("Joy", "A"))
        ]
        human = {"humanBones": [{"bone": name, "node": node} for name, node in bones.items()]}
        told = {
            "meta": {"title": "body"},
            "humanoid": human,
            "blendShapeMaster": {"blendShapeGroups": groups},
        }
        made.json["extensions"] = {"VRM": {**told, "secondaryAnimation": SPRING}}
    made.json["extensionsUsed"] = list(made.json["extensions"])
    return made.to_glb()


def _add_skeleton(made: GltfContainer, stature: float, turned: F64) -> None:
    """VRoid's bones of a standing person, and a skin of them."""
    numbers, places = {name: k for k, name in enumerate(STANDING)}, {}
    for name, (above, aside, up) in STANDING.items():
        side, part = (name[0].upper(), name.removeprefix("left").removeprefix("right"))
        places[name] = stature * np.array([np.sign(turned[0]) * aside, up, 0.0])
        shift = places[name] - (places[above] if above else 0)
        made.entries("nodes").append(
            {"name": f"J_Bip_{VROID_BONES.get(name, f'{side}_{part}')}", "translation": shift.tolist()}
        )
        if above:
            made.json["nodes"][numbers[above]].setdefault("children", []).append(numbers[name])
    inverse = np.tile(np.eye(4, dtype=np.float32), (len(places), 1, 1))
    inverse[:, 3, :3] = -np.stack(list(places.values()))
    view = made.append_view(inverse.tobytes())
    made.entries("accessors").append(
        {"bufferView": view, "componentType": 5126, "count": len(places), "type": "MAT4"}
    )
    made.json["skins"] = [{"joints": list(range(len(places))), "inverseBindMatrices": 0}]


def _add_mesh(
    made: GltfContainer, name: str, parts: dict[str, Any], avatar: Avatar, at: F64, ways: F64
) -> None:
    """A node with a primitive for each material, which share their vertices, all moved by one bone."""
    rows = np.concatenate(list(parts.values()))
    new = np.full(len(at), -1)
    new[rows] = np.arange(len(rows))
    joints, weights = np.zeros((len(rows), 4), np.uint16), np.zeros((len(rows), 4), np.float32)
    joints[:, 0], weights[:, 0] = 0 if name == "Body" else list(STANDING).index("head"), 1.0
    view = made.append_view(joints.tobytes(), GL_ARRAY_BUFFER)
    made.json["accessors"].append(
        {"bufferView": view, "componentType": 5123, "count": len(rows), "type": "VEC4"}
    )
    attributes = {"JOINTS_0": len(made.json["accessors"]) - 1}
    attributes["POSITION"] = made.append_accessor(at[rows].astype(np.float32), GL_ARRAY_BUFFER)
    attributes["WEIGHTS_0"] = made.append_accessor(weights, GL_ARRAY_BUFFER)
    targets = [
        {"POSITION": made.append_accessor(way[rows].astype(np.float32), GL_ARRAY_BUFFER)} for way in ways
    ]
    primitives = []
    for material, own in parts.items():
        faces = avatar.mesh.faces[np.isin(avatar.mesh.faces, own).all(1)]
        indices = made.append_accessor(new[faces].reshape(-1, 1).astype(np.uint32), GL_ELEMENT_ARRAY_BUFFER)
        made.entries("materials").append({"name": material})
        more = {"targets": targets, "extras": {"targetNames": list(ARTIST)}} if name == "Face" else {}
        held = {"attributes": attributes, "indices": indices, "material": len(made.json["materials"]) - 1}
        primitives.append({**held, **more})
    made.json["meshes"].append({"name": name, "primitives": primitives})
    made.json["nodes"].append({"name": name, "mesh": len(made.json["meshes"]) - 1, "skin": 0})


def measure_avatar(avatar: Avatar, version: int, folder: Path, report: Report) -> tuple[object, ...]:
    """One avatar: what is told of it."""
    path, out = folder / f"avatar{version}.vrm", folder / f"out{version}.vrm"
    path.write_bytes(vrm_bytes(avatar, version))
    told = transfer_rig(shipped_head(), path, out, overwrite=True)
    before, after = read_rig(path), read_rig(out)
    one, other = before.file.document, after.file.document
    assert isinstance(one, GltfDocument)
    assert isinstance(other, GltfDocument)
    rest = before.file.mesh.vertices
    own = {coefficient_of(name): way for name, way in zip(after.names, after.shapes, strict=True)}
    way = MM_PER_METRE * np.stack([np.linalg.norm(own[k] - rest, axis=1) for k in range(len(ARKIT_NAMES))])
    wanted = np.array([MM_PER_METRE * entry.furthest for entry in told.expressions])
    off = float(np.abs(way.max(1) - wanted).max())
    names = np.array(before.file.part_names)
    still = [way[:, names == NAMES["VRoid"][kind]].max(initial=0.0) for kind in STILL]
    kept = (
        np.abs(after.shapes[: len(ARTIST)] - before.shapes).max() < 1e-6
        and after.names[: len(ARTIST)] == ARTIST
    )
    same = one.container.buffer == other.container.buffer[: len(one.container.buffer)]
    customs = sum(coefficient_of(name) >= 0 and len(w) > 0 for name, w in after.expressions.items())
    presets = sum(name in PRESETS and len(w) > 0 for name, w in after.expressions.items())
    which = f"VRM {'1.0' if version else '0.x'}"
    report.criteria += [
        Criterion(f"{which}: names that come back", float(customs), ">=", 52.0),
        Criterion(f"{which}: the furthest vertex of a shape, off", off, "<=", MAX_ROUNDING_MM, "mm"),
        Criterion(f"{which}: what should be still", max(still), "<=", MAX_STILL_MM, "mm"),
        Criterion(f"{which}: the file's own bytes and shapes kept", float(same) + float(kept), ">=", 2.0),
    ]
    moved = float(np.median(way[:, names == NAMES["VRoid"]["head"]].max(1)))
    return which, len(after.names), customs, presets, moved, off, max(still), same


def measure(options: argparse.Namespace) -> Report:
    """Both versions."""
    report = Report(NAME, TITLE)
    avatar = People(Path(options.shared)).body("p03", "VRoid")
    with tempfile.TemporaryDirectory() as folder:
        versions = (1,) if options.quick else (1, 0)
        rows = [measure_avatar(avatar, version, Path(folder), report) for version in versions]
    columns = (
        "version", "shapes", "of ARKit, as expressions", "presets", "median motion, mm", "off, mm", "still, mm",
        "bytes kept",
    )  # fmt: skip
    report.tables.append(Table("Avatars in VRoid's layout", columns, rows))
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
