"""The bones of a human skeleton among the nodes of a glTF document, by the names that VRM has for them.

Names of nodes are read as Mixamo, Ready Player Me, VRoid, Unreal, Biped, Character Creator and Blender give them.  A
head without a skeleton gets one of a standing person in T-pose.
"""

from __future__ import annotations

import re

import numpy as np

from guise.analogy.formats.gltf_container import GltfContainer, Json
from guise.analogy.mesh import MeshError
from guise.common.arrays import F64

_PREFIX = re.compile(r"^(.*:)?(j_(bip|adj|sec)_|mixamorig\d*_?|cc_base_|bip0*1[_ ]|def-|c_)*")
_SIDES = re.compile(r"(?:^|[_. -])(l|left|r|right)(?:$|[_. -])|^(left|right)|(left|right)$")
_CENTRES = {"hips": r"hips?|pelvis", "head": r"head", "jaw": r"jaw"}
_CHAINS: tuple[dict[str, str], ...] = (
    {
        "Shoulder": r"shoulder|clavicle|collar(bone)?", "UpperArm": r"(upper)?arm",
        "LowerArm": r"(lower|fore)arm|elbow", "Hand": r"hand|wrist",
    },
    {
        "UpperLeg": r"up(per)?leg|thigh", "LowerLeg": r"(lower)?leg|calf|shin|knee", "Foot": r"foot|ankle",
        "Toes": r"toe(base|s)?|ball",
    },
    {"Eye": r"(face)?eye(ball)?"},
)  # fmt: skip
_FINGERS = {"Thumb": "thumb", "Index": "index", "Middle": "middle", "Ring": "ring", "Little": "little|pinky"}
_JOINTS = ("Proximal", "Intermediate", "Distal")
_THUMB_JOINTS = ("Metacarpal", "Proximal", "Distal")
HEADS_IN_STATURE = 7.5
JOINT_HEIGHT = 0.2  # of a head, at which it turns on the neck
# The bones that VRM 1.0 requires: above, and where a standing person has them, aside and up, in statures.
STANDING: dict[str, tuple[str | None, float, float]] = {
    "hips": (None, 0.0, 0.53), "spine": ("hips", 0.0, 0.58), "head": ("spine", 0.0, 0.87),
}  # fmt: skip
for _side, _sign in (("left", 1), ("right", -1)):
    for _part, _above, _aside, _up in (
        ("UpperLeg", "hips", 0.05, 0.5), ("LowerLeg", "UpperLeg", 0.05, 0.27), ("Foot", "LowerLeg", 0.05, 0.04),
        ("UpperArm", "spine", 0.1, 0.81), ("LowerArm", "UpperArm", 0.27, 0.81), ("Hand", "LowerArm", 0.41, 0.81),
    ):  # fmt: skip
        _name = _above if _above.islower() else _side + _above
        STANDING[_side + _part] = (_name, _sign * _aside, _up)


def find_bones(nodes: list[Json]) -> dict[str, int]:
    """The nodes of bones by VRM's names, each below the one that it belongs to; others are left out."""
    parents = {child: k for k, node in enumerate(nodes) for child in node.get("children", [])}
    read = [_read_name(str(node.get("name", ""))) for node in nodes]
    found: dict[str, int] = {}

    def look(bone: str, side: str, pattern: str, below: str | None) -> bool:
        above = None if below is None else found.get(below)
        for k, (own_side, stem) in enumerate(read):
            if (
                own_side == side
                and re.fullmatch(pattern, stem)
                and (above is None or above in _nodes_above(k, parents))
            ):
                found[bone] = k
                return True
        return False

    if not look("hips", "", _CENTRES["hips"], None):
        return {}
    if look("head", "", _CENTRES["head"], "hips"):
        found |= _spine(found["hips"], found["head"], parents, read)
        look("jaw", "", _CENTRES["jaw"], "head")
    for side in ("left", "right"):
        for chain, start in zip(_CHAINS, ("hips", "hips", "head"), strict=True):
            below = start
            for part, pattern in chain.items():
                if look(f"{side}{part}", side, pattern, below):
                    below = f"{side}{part}"
        for finger, pattern in _FINGERS.items():
            for number, joint in enumerate(_THUMB_JOINTS if finger == "Thumb" else _JOINTS, 1):
                if not look(
                    f"{side}{finger}{joint}", side, rf"(hand)?({pattern})(finger)?0*{number}", f"{side}Hand"
                ):
                    break
    return found


def _nodes_above(node: int, parents: dict[int, int]) -> list[int]:
    """The nodes above a node, nearest first."""
    found: list[int] = []
    while node in parents and parents[node] not in found:
        node = parents[node]
        found.append(node)
    return found


def _spine(hips: int, head: int, parents: dict[int, int], read: list[tuple[str, str]]) -> dict[str, int]:
    """What is between hips and head."""
    above = _nodes_above(head, parents)
    chain = above[: above.index(hips)][::-1]
    necks = [k for k in chain if read[k][1].startswith("neck")]
    backs = [k for k in chain if k not in necks]
    found = dict(zip(("spine", "chest"), backs, strict=False))
    if len(backs) > 2:
        found["upperChest"] = backs[-1]
    return found | ({"neck": necks[0]} if necks else {})


def _read_name(name: str) -> tuple[str, str]:
    """The side ("left", "right" or "") and the rest of a node's name.

    >>> _read_name("J_Bip_L_UpperArm"), _read_name("mixamorig:LeftUpLeg"), _read_name("upper_arm.R")
    (('left', 'upperarm'), ('left', 'upleg'), ('right', 'upperarm'))
    """
    plain = _PREFIX.sub("", name.lower())
    found = _SIDES.search(plain)
    side = "" if found is None else {"l": "left", "r": "right"}[next(filter(None, found.groups()))[0]]
    rest = plain if found is None else f"{plain[: found.start()]}_{plain[found.end() :]}"
    return side, re.sub(r"[_. -]", "", rest)


def bones_of(made: GltfContainer) -> dict[str, int]:
    """The bones of a document that VRM requires, and others.

    Empty for a head without a skeleton.

    Raises
    ------
    MeshError
        When there is a skeleton, but required bones are not found.
    """
    found = find_bones(made.json.get("nodes", []))
    missing = [name for name in STANDING if name not in found]
    if not found or not any(name.endswith(("Arm", "Leg", "Hand", "Foot")) for name in found):
        return {}
    if missing:
        raise MeshError(
            f"VRM asks for a human skeleton, and it has no node for {', '.join(missing)}: name its bones as VRM or "
            "Mixamo does, or write a .glb"
        )
    return found


def add_standing_bones(made: GltfContainer, roots: list[int], low: F64, high: F64) -> dict[str, int]:
    """Put a head under the head of a new skeleton that stands on the ground; its bones.

    roots : the nodes of the scene.   low, high : (3,) corners of the head.
    """
    size = float(high[1] - low[1])
    joint = np.array([(low[0] + high[0]) / 2, low[1] + JOINT_HEIGHT * size, (low[2] + high[2]) / 2])
    nodes, at, bones = made.entries("nodes"), dict[str, F64](), dict[str, int]()
    for name, (below, aside, up) in STANDING.items():
        at[name] = np.array([aside, up, 0.0]) * HEADS_IN_STATURE * size
        bones[name] = len(nodes)
        shift = at[name] - (0 if below is None else at[below])
        nodes.append({"name": name, "translation": shift.tolist()})
        if below is not None:
            nodes[bones[below]].setdefault("children", []).append(bones[name])
    nodes.append({"name": "on the neck", "translation": (-joint).tolist(), "children": roots})
    nodes[bones["head"]]["children"] = [len(nodes) - 1]
    made.json["scenes"][made.json.setdefault("scene", 0)]["nodes"] = [bones["hips"]]
    return bones
