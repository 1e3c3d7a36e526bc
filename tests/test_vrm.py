"""Avatars as VRM 0.x and 1.0: expressions are read and written, and nothing else of a file is lost."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_mesh import sheet
from test_mesh_avatar import problems
from test_mesh_gltf import TRIANGLES, Glb, Json, document, ways

from guise.aam.rig.names import ARKIT_NAMES, INDEX
from guise.aam.rig.presets import PRESETS, SHOWN, preset_values
from guise.analogy.formats.files import has_skeleton, read_mesh, read_rig, write_rig
from guise.analogy.formats.humanoid import STANDING, find_bones
from guise.analogy.mesh import MeshError
from guise.app.cli.main import main
from guise.app.rig.curves import RigCurves
from guise.app.rig.head import open_head
from guise.app.rig.vmc import messages
from guise.app.studio.rig_heads import DrawnRig
from guise.common.arrays import F64

ARTIST = ("Fcl_ALL_Joy", "Fcl_MTH_A")
SPRINGS = {"specVersion": "1.0", "springs": [{"name": "hair", "joints": [{"node": 2}]}]}
BIND = {"type": "object", "required": ["node", "index", "weight"], "additionalProperties": False, "properties": {
    "node": {"type": "integer", "minimum": 0}, "index": {"type": "integer", "minimum": 0},
    "weight": {"type": "number", "minimum": 0, "maximum": 1},
}}  # fmt: skip
EXPRESSIONS = {
    "type": "object",
    "additionalProperties": {
        "type": "object", "properties": {"morphTargetBinds": {"type": "array", "items": BIND}}, "minProperties": 1,
    },
}  # fmt: skip
TEXT = {"type": "string", "minLength": 1}
# What VRM's specification says of `VRMC_vrm` (VRMC_vrm-1.0: meta.md, humanoid.md, expressions.md, lookAt.md).
SCHEMA = {
    "type": "object", "required": ["specVersion", "meta", "humanoid"],
    "properties": {
        "specVersion": {"const": "1.0"},
        "meta": {
            "type": "object", "required": ["name", "authors", "licenseUrl"],
            "properties": {
                "name": TEXT, "authors": {"type": "array", "minItems": 1, "items": TEXT},
                "licenseUrl": {"const": "https://vrm.dev/licenses/1.0/"},
            },
        },
        "humanoid": {"type": "object", "required": ["humanBones"], "properties": {"humanBones": {
            "type": "object", "required": [
                "hips", "spine", "head", *(
                    f"{side}{part}" for side in ("left", "right")
                    for part in ("UpperLeg", "LowerLeg", "Foot", "UpperArm", "LowerArm", "Hand")
                ),
            ],
            "additionalProperties": {"required": ["node"], "properties": {"node": {"type": "integer"}}},
        }}},
        "expressions": {"type": "object", "properties": {
            "preset": {**EXPRESSIONS, "propertyNames": {"enum": list(PRESETS)}},
            "custom": {**EXPRESSIONS, "propertyNames": {"not": {"enum": list(PRESETS)}}},
        }},
        "lookAt": {"type": "object", "properties": {"type": {"enum": ["bone", "expression"]}}},
    },
}  # fmt: skip


def require_valid(held: Json) -> None:
    """Schema, ranges, and that each bone is one node."""
    own = held["extensions"]["VRMC_vrm"]
    jsonschema.Draft202012Validator(SCHEMA).validate(own)
    assert "VRMC_vrm" in held["extensionsUsed"]
    bones = [bone["node"] for bone in own["humanoid"]["humanBones"].values()]
    assert len(set(bones)) == len(bones)
    assert max(bones) < len(held["nodes"])
    for kind in ("preset", "custom"):
        for expression in own["expressions"].get(kind, {}).values():
            for bind in expression["morphTargetBinds"]:
                mesh = held["meshes"][held["nodes"][bind["node"]]["mesh"]]
                assert all(bind["index"] < len(one["targets"]) for one in mesh["primitives"])


def with_bones(made: Glb, called: Callable[[str], str] = str) -> dict[str, int]:
    """The bones of a standing person in a file."""
    nodes: dict[str, int] = {}
    for name, (above, aside, up) in STANDING.items():
        nodes[name] = len(made.json["nodes"])
        made.json["nodes"].append({"name": called(name), "translation": [aside, up, 0.0]})
        if above:
            made.json["nodes"][nodes[above]].setdefault("children", []).append(nodes[name])
    made.json["scenes"][0]["nodes"].append(nodes["hips"])
    return nodes


def avatar(version: int) -> Glb:
    """Two expressions of an artist, springs, and a picture."""
    made = Glb()
    bones = with_bones(made)
    own = dict(zip(ARTIST, ways(2).values(), strict=True))
    face = made.node(mesh=made.mesh(sheet(), TRIANGLES, own), name="Face", weights=[0.0, 0.25])
    made.json["images"] = [{"bufferView": made.view(np.arange(16, dtype=np.uint8)), "mimeType": "image/png"}]
    if version:
        bind = {"node": face, "index": 0, "weight": 0.5}
        own_1 = {
            "specVersion": "1.0",
            "meta": {
                "name": "a",
                "authors": ["b"],
                "licenseUrl": "https://vrm.dev/licenses/1.0/",
                "version": "7",
            },
            "humanoid": {"humanBones": {name: {"node": node} for name, node in bones.items()}},
            "expressions": {
                "preset": {"happy": {"isBinary": True, "morphTargetBinds": [bind]}},
                "custom": {"wink": {"morphTargetBinds": [{**bind, "index": 1, "weight": 1.0}]}},
            },
        }
        made.json["extensions"] = {"VRMC_vrm": own_1, "VRMC_springBone": SPRINGS}
    else:
        groups = [
            {
                "name": "Joy",
                "presetName": "joy",
                "isBinary": True,
                "binds": [{"mesh": 0, "index": 0, "weight": 50}],
            },
            {"name": "wink", "presetName": "unknown", "binds": [{"mesh": 0, "index": 1, "weight": 100}]},
            {"name": "A", "presetName": "a", "binds": [], "materialValues": []},
        ]
        human = [{"bone": name, "node": node} for name, node in bones.items()]
        own_0 = {"meta": {"title": "a"}, "humanoid": {"humanBones": human}, "secondaryAnimation": SPRINGS}
        made.json["extensions"] = {"VRM": {**own_0, "blendShapeMaster": {"blendShapeGroups": groups}}}
    made.json["extensionsUsed"] = list(made.json["extensions"])
    return made


def write_avatar(folder: Path, version: int) -> Path:
    path = folder / f"avatar{version}.vrm"
    path.write_bytes(avatar(version).data())
    return path


def arkit_shapes(rest: F64) -> F64:
    rng = np.random.default_rng(5)
    return rest + rng.integers(-32, 32, (52, *rest.shape)) / 64


@pytest.mark.parametrize("version", [0, 1])
def test_expressions_are_weights_of_morph_targets(version: int, tmp_path: Path) -> None:
    rig = read_rig(write_avatar(tmp_path, version))
    assert rig.names == ARTIST
    told = {name: dict(weights) for name, weights in rig.expressions.items() if weights}
    assert told == {"happy": {ARTIST[0]: 0.5}, "wink": {ARTIST[1]: 1.0}}


@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize("suffix", [".vrm", ".glb"])
def test_an_avatar_keeps_what_it_has_and_gets_the_52(version: int, suffix: str, tmp_path: Path) -> None:
    path, out = write_avatar(tmp_path, version), tmp_path / f"out{suffix}"
    target, before = read_mesh(path), read_rig(path)
    shapes = arkit_shapes(target.mesh.vertices)
    write_rig(out, target, ARKIT_NAMES, shapes, expressions={})
    after, held, was = read_rig(out), document(out), document(path)
    assert problems(out) == []
    assert after.names == (*ARTIST, *ARKIT_NAMES)
    assert_allclose(after.shapes[:2], before.shapes, atol=1e-7)
    assert_allclose(after.shapes[2:], shapes, atol=1e-6)
    assert after.expressions["happy"] == {ARTIST[0]: 0.5}
    assert after.expressions["wink"] == {ARTIST[1]: 1.0}
    assert after.expressions["EyeBlinkLeft"] == {"eyeBlinkLeft": 1.0}
    for name, weights in PRESETS.items():
        if weights and name != "happy":
            assert after.expressions[name] == pytest.approx(weights)
    assert len([name for name in after.expressions if name[0].lower() + name[1:] in INDEX]) == 52
    data = path.read_bytes()
    assert data[-was["buffers"][0]["byteLength"] :] in out.read_bytes()
    assert [node.get("name") for node in held["nodes"]] == [node.get("name") for node in was["nodes"]]
    assert held["nodes"][-1]["weights"] == [0.0, 0.25, *[0.0] * 52]
    if version:
        require_valid(held)
        assert held["extensions"]["VRMC_vrm"]["meta"] == was["extensions"]["VRMC_vrm"]["meta"]
        assert held["extensions"]["VRMC_vrm"]["expressions"]["preset"]["happy"]["isBinary"]
        assert held["extensions"]["VRMC_springBone"] == SPRINGS
    else:
        own = held["extensions"]["VRM"]
        assert {**own, "blendShapeMaster": 0} == {**was["extensions"]["VRM"], "blendShapeMaster": 0}
        assert own["blendShapeMaster"]["blendShapeGroups"][0]["isBinary"]
    write_rig(tmp_path / f"again{suffix}", read_mesh(out), ARKIT_NAMES, shapes, expressions=after.expressions)
    again = read_rig(tmp_path / f"again{suffix}")
    assert again.names == after.names
    assert again.expressions == after.expressions


def test_expressions_of_the_source_come_along(tmp_path: Path) -> None:
    made = Glb()
    with_bones(made)
    made.node(mesh=made.mesh(sheet(), TRIANGLES))
    target, source = made.read(tmp_path), read_rig(write_avatar(tmp_path, 0))
    out = tmp_path / "out.vrm"
    write_rig(out, target, source.names, source.shapes, expressions=source.expressions, authors=["me"])
    assert read_rig(out).expressions == {"happy": {ARTIST[0]: 0.5}, "wink": {ARTIST[1]: 1.0}}
    require_valid(document(out))


def test_a_film_of_an_avatar_leaves_no_expression_pointing_at_what_is_gone(tmp_path: Path) -> None:
    for version in (0, 1):
        target = read_mesh(write_avatar(tmp_path, version))
        write_rig(tmp_path / "out.glb", target, ["component 1"], target.mesh.vertices[None] + 1)
        rig = read_rig(tmp_path / "out.glb")
        assert rig.names == ("component 1",)
        assert not any(rig.expressions.values())


NAMES = {
    "Mixamo": lambda name: "mixamorig:" + {
        "hips": "Hips", "spine": "Spine", "head": "Head",
    }.get(name, name[0].upper() + name[1:].replace("UpperArm", "Arm").replace("LowerArm", "ForeArm")
          .replace("UpperLeg", "UpLeg").replace("LowerLeg", "Leg")),
    "VRoid": lambda name: "J_Bip_" + (
        f"{name[0].upper()}_{name.removeprefix('left').removeprefix('right')}"
        if name.startswith(("left", "right")) else f"C_{name.title()}"
    ),
    "Unreal": lambda name: {"hips": "pelvis", "spine": "spine_01", "head": "head"}.get(
        name, name.removeprefix("left").removeprefix("right").lower().replace("upperleg", "thigh")
        .replace("lowerleg", "calf") + f"_{name[0]}",
    ),
    "Blender": lambda name: {"hips": "hips", "spine": "spine", "head": "head"}.get(
        name, name.removeprefix("left").removeprefix("right").lower().replace("upper", "upper_")
        .replace("lowerarm", "forearm").replace("lowerleg", "shin") + f".{name[0].upper()}",
    ),
}  # fmt: skip


@pytest.mark.parametrize("program", list(NAMES))
def test_a_skeleton_is_found_by_the_names_of_programs(program: str) -> None:
    made = Glb()
    bones = with_bones(made, NAMES[program])
    assert find_bones(made.json["nodes"]) == bones


def test_a_head_alone_stands_on_bones_that_are_added(tmp_path: Path) -> None:
    made = Glb()
    made.node(mesh=made.mesh(sheet(), TRIANGLES), name="head", translation=[0.0, 3.0, 0.0])
    target = made.read(tmp_path)
    assert not has_skeleton(target)
    out = tmp_path / "out.vrm"
    write_rig(
        out, target, ARKIT_NAMES, arkit_shapes(target.mesh.vertices), 0.1, expressions={}, authors=["me"]
    )
    held = document(out)
    require_valid(held)
    assert problems(out) == []
    again = read_mesh(out)
    assert_allclose(
        np.ptp(again.mesh.vertices, axis=0), 0.1 * np.ptp(target.mesh.vertices, axis=0), atol=1e-6
    )
    assert again.mesh.vertices[:, 1].min() > 0
    bones = held["extensions"]["VRMC_vrm"]["humanoid"]["humanBones"]
    assert held["nodes"][held["nodes"][bones["head"]["node"]]["children"][0]]["name"] == "on the neck"


def test_a_skeleton_that_lacks_bones_is_told(tmp_path: Path) -> None:
    made = Glb()
    with_bones(made, lambda name: "x" if name == "leftFoot" else name)
    made.node(mesh=made.mesh(sheet(), TRIANGLES))
    with pytest.raises(
        MeshError, match=r"VRM asks for a human skeleton, and it has no node for leftFoot: name"
    ):
        has_skeleton(made.read(tmp_path))


def happy(held: Json) -> Json:
    """What the expression binds."""
    found: Json = held["VRMC_vrm"]["expressions"]["preset"]["happy"]["morphTargetBinds"][0]
    return found


def changed_1(change: Callable[[Json], Any]) -> bytes:
    made = avatar(1)
    made.json = json.loads(json.dumps(made.json))
    change(made.json["extensions"])
    return made.data()


BAD: dict[str, tuple[bytes, str]] = {
    "no object": (changed_1(lambda held: held.update(VRMC_vrm=3)), "its VRM extension is damaged"),
    "no bones": (changed_1(lambda held: held["VRMC_vrm"].pop("humanoid")), "its VRM extension is damaged"),
    "a node that is not there": (
        changed_1(lambda held: happy(held).update(node=99)),
        "its expression happy points at node 99, which is not there",
    ),
    "a node without a mesh": (
        changed_1(lambda held: happy(held).update(node=0)),
        "its expression happy points at morph target 0 of node 0, which has 0",
    ),
    "a bone that is not there": (
        changed_1(lambda held: held["VRMC_vrm"]["humanoid"]["humanBones"]["head"].update(node=-1)),
        "its bone head points at node -1",
    ),
    "a new version": (changed_1(lambda held: held["VRMC_vrm"].update(specVersion="2.0")), "it is VRM 2.0, but only"),
    "encrypted": (bytes(range(256)), "it is no VRM file, or an encrypted one"),
}  # fmt: skip


@pytest.mark.parametrize("bad", list(BAD))
def test_a_bad_avatar_is_one_sentence(bad: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, sentence = BAD[bad]
    (here / "bad.vrm").write_bytes(data)
    for arguments in (
        ["analogy", "mesh", "rig", "bad.vrm", "--target", "bad.vrm", "-o", "out.vrm"],
        ["rig", "from-video", "clip.mp4", "-o", "out.glb", "--head", "bad.vrm"],
    ):
        assert main(arguments) == 2
        said = capsys.readouterr().err.strip().splitlines()
        assert len(said) == 1
        assert "cannot use bad.vrm" in said[0]
        assert sentence in said[0]
    assert [path.name for path in here.iterdir()] == ["bad.vrm"]


def test_a_new_avatar_needs_an_author_and_a_film_an_avatar(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_avatar(here, 1)
    made = Glb()
    made.node(mesh=made.mesh(sheet(), TRIANGLES, {"jawOpen": ways()["jawOpen 0"]}))
    made.read(here)
    assert main(["analogy", "mesh", "rig", "avatar1.vrm", "--target", "made.glb", "-o", "out.vrm"]) == 2
    assert (
        "a VRM names its authors, and made.glb is no VRM yet: give --author NAME" in capsys.readouterr().err
    )
    assert main(["rig", "from-video", "clip.mp4", "-o", "out.vrm", "--head", "made.glb"]) == 2
    assert "out.vrm needs an avatar that is a VRM: give it with --head" in capsys.readouterr().err


def looking(version: int, head: F64, folder: Path) -> F64:
    """The quaternion that turns the head of an avatar with ARKit's expressions."""
    path = folder / f"driven{version}.vrm"
    target = read_mesh(write_avatar(folder, version))
    write_rig(path, target, ARKIT_NAMES, arkit_shapes(target.mesh.vertices), expressions={})
    driven = open_head(path)
    assert driven.shapes == 52
    assert set(driven.nodes) == {"head"}
    curves = RigCurves(
        np.arange(2.0), np.eye(52)[:2], head[None] * [[0], [1]], np.zeros((2, 2, 3)), np.ones(2, bool)
    )
    (folder / "film.glb").write_bytes(driven.animated(curves))
    film = read_mesh(folder / "film.glb").document
    (animation,) = film.container.json["animations"]  # type: ignore[attr-defined]
    values = {
        one["target"]["path"]: film.container.read_accessor(animation["samplers"][one["sampler"]]["output"])  # type: ignore[attr-defined]
        for one in animation["channels"]
    }
    assert_allclose(values["weights"].reshape(2, 54)[:, 2:], np.eye(52)[:2])
    return np.asarray(values["rotation"][1], np.float64)


def test_an_avatar_that_looks_backwards_turns_as_one_that_looks_forwards(tmp_path: Path) -> None:
    head = np.array([20.0, 10.0, 5.0])
    x, y, z, w = looking(1, head, tmp_path)
    assert_allclose(looking(0, head, tmp_path), [-x, y, -z, w], atol=1e-6)


def test_an_avatar_is_driven_by_its_expressions_with_their_weights(tmp_path: Path) -> None:
    made = avatar(1)
    made.json["extensions"]["VRMC_vrm"]["expressions"]["custom"] = {
        "EyeBlinkLeft": {
            "morphTargetBinds": [{"node": 15, "index": 0, "weight": 0.5}, {"node": 15, "index": 1}]
        },
        "JawOpen": {"morphTargetBinds": []},
    }
    (tmp_path / "a.vrm").write_bytes(made.data())
    driven = open_head(tmp_path / "a.vrm")
    wanted = np.zeros((52, 2))
    wanted[INDEX["eyeBlinkLeft"]] = 0.5, 1.0
    assert_allclose(driven.weights[15], wanted)
    assert driven.shapes == 1


def test_the_browser_sees_every_avatar_from_the_front_with_its_weights(tmp_path: Path) -> None:
    drawn = []
    for version in (0, 1):
        looking(version, np.zeros(3), tmp_path)
        drawn.append(DrawnRig.of(tmp_path / f"driven{version}.vrm", tmp_path / f"{version}.glb"))
        extras = document(tmp_path / f"{version}.glb")["meshes"][0]["extras"]
        assert extras["guiseShapes"] == [[], [], *([[k, 1.0]] for k in range(52))]
    assert_allclose(drawn[0].centre, drawn[1].centre * (-1, 1, -1), atol=1e-6)


def test_presets_of_a_face_are_those_that_made_it() -> None:
    for name in SHOWN:
        weights = np.zeros(52)
        weights[[INDEX[shape] for shape in PRESETS[name]]] = list(PRESETS[name].values())
        assert preset_values(0.5 * weights) == pytest.approx(
            {**dict.fromkeys(SHOWN, 0.0), name: 0.5}, abs=1e-6
        )


def test_presets_are_sent_under_both_names() -> None:
    from guise.aam.rig.coefficients import Coefficients

    weights = np.zeros(52, np.float32)
    weights[[INDEX["eyeBlinkLeft"], INDEX["eyeBlinkRight"]]] = 1.0
    found = Coefficients(weights, np.zeros(3), np.zeros((2, 3)))
    sent = [b"".join(messages(found, 0.0, calibrated=True, presets=presets)) for presets in (False, True)]
    assert b"blinkLeft\0" not in sent[0]
    assert all(name in sent[1] for name in (b"blinkLeft\0", b"Blink_L\0", b"Joy\0", b"happy\0"))


def test_the_table_of_the_docs_is_that_of_the_presets() -> None:
    text = (Path(__file__).parents[1] / "docs" / "rig.md").read_text(encoding="utf-8")
    rows = text.partition("| preset | shapes |\n|---|---|\n")[2].partition("\n\n")[0].splitlines()
    told: dict[str, dict[str, float]] = {"neutral": {}}
    for preset, shapes in (row.strip("| ").split(" | ") for row in rows):
        for name, weight in (entry.split() for entry in shapes.split(", ")):
            for one in [name] if name in INDEX else [f"{name}Left", f"{name}Right"]:
                told.setdefault(preset, {})[one] = float(weight)
    assert told == PRESETS
