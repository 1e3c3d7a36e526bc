"""VRM 0.x and 1.0 in a glTF document: an avatar's bones and expressions, read, added and made anew.

An expression has weights of morph targets.  Names are VRM 1.0's; those of 0.x presets are translated ("joy" is
"happy").  What is written into an avatar keeps the version that it has, and everything else in it.  Source:
vrm-specification, VRMC_vrm-1.0 and 0.0.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from guise.aam.rig.names import ARKIT_NAMES, FULL_LOOK_DEGREES, coefficient_of, perfect_sync_name
from guise.aam.rig.presets import PRESETS
from guise.analogy.formats.gltf_container import GltfContainer, Json
from guise.analogy.mesh import MeshError, printable_excerpt

LICENSE = (
    "https://vrm.dev/licenses/1.0/"  # the only one that VRM 1.0 takes; without more, it permits the least
)
VERSIONS = ("1.0", "1.0-beta")
FULL_WEIGHT_0 = 100.0  # of VRM 0.x
LEGACY_NAMES = {
    "aa": "A", "ih": "I", "ou": "U", "ee": "E", "oh": "O", "blink": "Blink", "blinkLeft": "Blink_L",
    "blinkRight": "Blink_R", "happy": "Joy", "angry": "Angry", "sad": "Sorrow", "relaxed": "Fun", "lookUp": "LookUp",
    "lookDown": "LookDown", "lookLeft": "LookLeft", "lookRight": "LookRight", "neutral": "Neutral",
    "surprised": "Surprised",
}  # fmt: skip
_FROM_LEGACY = {name.lower(): new for new, name in LEGACY_NAMES.items()}
_UNKNOWN = "unknown"  # the preset of VRM 0.x for all others, as for surprise
Weights = Mapping[str, float]  # of morph targets by name


@dataclass(frozen=True)
class Bind:
    """A morph target of a node, and its weight where the expression is 1."""

    node: int
    index: int
    weight: float


@dataclass(frozen=True)
class Vrm:
    """An avatar.

    Parameters
    ----------
    version : 0 or 1.   bones : node by name.   expressions : by name; a preset without morph targets has none.
    """

    version: int
    bones: dict[str, int]
    expressions: dict[str, tuple[Bind, ...]]


@dataclass(frozen=True)
class VrmMeta:
    """What a new VRM says of itself."""

    name: str
    authors: tuple[str, ...]


def read_vrm(held: Json) -> Vrm | None:
    """The avatar in a glTF document, if it is a VRM.

    Raises
    ------
    MeshError
        When its extension is damaged, of an unknown version, or an expression points at what is not there.
    """
    try:
        extensions = held.get("extensions") or {}
        if "VRMC_vrm" in extensions:
            return _read_1(held, extensions["VRMC_vrm"])
        return _read_0(held, extensions["VRM"]) if "VRM" in extensions else None
    except MeshError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        said = f"{type(error).__name__}: {printable_excerpt(str(error))}"
        raise MeshError(f"its VRM extension is damaged ({said}): export it again") from error


def _read_1(held: Json, own: Json) -> Vrm:
    version = str(own["specVersion"])
    if version not in VERSIONS:
        raise MeshError(f"it is VRM {printable_excerpt(version)}, but only 0.x and 1.0 are read")
    bones = {
        name: _node(held, bone["node"], f"bone {name}")
        for name, bone in own["humanoid"]["humanBones"].items()
    }
    given = own.get("expressions") or {}
    entries = {**(given.get("custom") or {}), **(given.get("preset") or {})}
    return Vrm(1, bones, {name: tuple(_binds_1(held, name, one)) for name, one in entries.items()})


def _binds_1(held: Json, name: str, expression: Json) -> Iterator[Bind]:
    for bind in expression.get("morphTargetBinds") or []:
        node = _node(held, bind["node"], f"expression {name}")
        yield _bind(held, name, node, bind["index"], float(bind.get("weight", 1.0)))


def _read_0(held: Json, own: Json) -> Vrm:
    version = str(own.get("specVersion") or "0.0")
    if not version.startswith("0."):
        raise MeshError(f"it is VRM {printable_excerpt(version)}, but only 0.x and 1.0 are read")
    listed = (own.get("humanoid") or {}).get("humanBones") or []
    bones = {str(one["bone"]): _node(held, one["node"], f"bone {one['bone']}") for one in listed}
    expressions: dict[str, tuple[Bind, ...]] = {}
    for group in _groups(own):
        called = str(group.get("name"))
        name = _FROM_LEGACY.get(str(group.get("presetName")).lower(), _same(called, ["surprised"]))
        expressions[name] = tuple(_binds_0(held, name, group))
    return Vrm(0, bones, expressions)


def _binds_0(held: Json, name: str, group: Json) -> Iterator[Bind]:
    for bind in group.get("binds") or []:
        nodes = [k for k, node in enumerate(held["nodes"]) if node.get("mesh") == bind["mesh"]]
        if not nodes:
            raise MeshError(
                f"its expression {printable_excerpt(name)} points at mesh {bind['mesh']}, which no node has"
            )
        for node in nodes:
            yield _bind(
                held, name, node, bind["index"], float(bind.get("weight", FULL_WEIGHT_0)) / FULL_WEIGHT_0
            )


def _groups(own: Json) -> list[Json]:
    """The expressions of VRM 0.x, a list in the document."""
    found: list[Json] = own.setdefault("blendShapeMaster", {}).setdefault("blendShapeGroups", [])
    return found


def _node(held: Json, node: Any, who: str) -> int:
    if not isinstance(node, int) or not 0 <= node < len(held.get("nodes", [])):
        raise MeshError(f"its {printable_excerpt(who)} points at node {node}, which is not there")
    return node


def _bind(held: Json, name: str, node: int, index: Any, weight: float) -> Bind:
    mesh = held["nodes"][node].get("mesh")
    targets = [] if mesh is None else held["meshes"][mesh]["primitives"][0].get("targets", [])
    if not isinstance(index, int) or not 0 <= index < len(targets):
        raise MeshError(
            f"its expression {printable_excerpt(name)} points at morph target {index} of node {node}, which has "
            f"{len(targets)}"
        )
    return Bind(node, index, weight)


def clear_expressions(held: Json) -> None:
    """Take the morph targets, which are gone, out of all expressions."""
    extensions = held.get("extensions") or {}
    given = (extensions.get("VRMC_vrm") or {}).get("expressions") or {}
    for expression in (*(given.get("preset") or {}).values(), *(given.get("custom") or {}).values()):
        expression.pop("morphTargetBinds", None)
    for group in _groups(extensions["VRM"]) if "VRM" in extensions else []:
        group["binds"] = []


def write_expressions(made: GltfContainer, names: Sequence[str], source: Mapping[str, Weights]) -> None:
    """Give an avatar an expression for each of its new morph targets, and the presets that it lacks.

    A preset is that of the source, or else a sum of ARKit's shapes.

    names : of the morph targets.   source : expressions of the head that they come from.
    """
    own = {k: name for name in names if (k := coefficient_of(name)) >= 0}
    plain: dict[str, Weights] = {perfect_sync_name(ARKIT_NAMES[k]): {name: 1.0} for k, name in own.items()}
    if not source:
        plain |= {name: {name: 1.0} for name in names if coefficient_of(name) < 0}
    customs = {name: w for name, w in plain.items() if name not in PRESETS}
    customs |= {name: w for name, w in source.items() if name not in PRESETS and coefficient_of(name) < 0}
    sums = {
        preset: {own[k]: w for name, w in weights.items() if (k := coefficient_of(name)) in own}
        for preset, weights in PRESETS.items()
    }
    given = {name: w for name, w in (*plain.items(), *source.items()) if name in PRESETS and w}
    presets: dict[str, Weights] = {**sums, **given}
    extensions = made.json["extensions"]
    places = _places(made.json)
    for wanted, replaced in ((customs, True), (presets, False)):
        for name, weights in wanted.items():
            if not weights:
                continue
            binds = [(*place, w) for target, w in weights.items() for place in places.get(target, ())]
            if "VRMC_vrm" in extensions:
                _write_1(extensions["VRMC_vrm"], name, binds, replaced=replaced)
            else:
                _write_0(extensions["VRM"], made.json, name, binds, replaced=replaced)


def _places(held: Json) -> dict[str, list[tuple[int, int]]]:
    """Node and index of the morph targets of each name."""
    found: dict[str, list[tuple[int, int]]] = {}
    for node, own in enumerate(held["nodes"]):
        mesh = held["meshes"][own["mesh"]] if "mesh" in own else {}
        for index, name in enumerate((mesh.get("extras") or {}).get("targetNames", [])):
            found.setdefault(name, []).append((node, index))
    return found


def _write_1(own: Json, name: str, binds: Iterable[tuple[int, int, float]], *, replaced: bool) -> None:
    held = own.setdefault("expressions", {}).setdefault("preset" if name in PRESETS else "custom", {})
    entry = held.setdefault(_same(name, held), {})
    if replaced or not any(value for key, value in entry.items() if key.endswith("Binds")):
        entry["morphTargetBinds"] = [{"node": node, "index": index, "weight": w} for node, index, w in binds]


def _write_0(
    own: Json, held: Json, name: str, binds: Iterable[tuple[int, int, float]], *, replaced: bool
) -> None:
    called, groups = LEGACY_NAMES.get(name, name), _groups(own)
    preset = called.lower() if name in LEGACY_NAMES and name != "surprised" else _UNKNOWN
    key = "name" if preset == _UNKNOWN else "presetName"
    entry = next(
        (one for one in groups if str(one.get(key)).lower() == (called if key == "name" else preset).lower()),
        None,
    )
    if entry is None:
        entry = {"name": called, "presetName": preset, "binds": [], "materialValues": [], "isBinary": False}
        groups.append(entry)
    if replaced or not (entry.get("binds") or entry.get("materialValues")):
        entry["binds"] = [
            {"mesh": held["nodes"][node]["mesh"], "index": index, "weight": FULL_WEIGHT_0 * w}
            for node, index, w in binds
        ]


def _same(name: str, held: Iterable[str]) -> str:
    """The name as it is among others, whatever its case."""
    return next((one for one in held if one.lower() == name.lower()), name)


def add_vrm(made: GltfContainer, meta: VrmMeta, bones: Mapping[str, int]) -> None:
    """Make a document a VRM 1.0 without expressions."""
    about = {"name": meta.name, "authors": list(meta.authors), "licenseUrl": LICENSE}
    if "copyright" in made.json["asset"]:
        about["copyrightInformation"] = made.json["asset"]["copyright"]
    span = {"inputMaxValue": FULL_LOOK_DEGREES, "outputScale": 1.0}
    ways = ("HorizontalInner", "HorizontalOuter", "VerticalDown", "VerticalUp")
    look = {
        "type": "expression",
        "offsetFromHeadBone": [0.0, 0.06, 0.0],
        **{f"rangeMap{way}": span for way in ways},
    }
    human = {name: {"node": node} for name, node in bones.items()}
    made.json.setdefault("extensions", {})["VRMC_vrm"] = {
        "specVersion": VERSIONS[0], "meta": about, "humanoid": {"humanBones": human}, "lookAt": look,
    }  # fmt: skip
    made.entries("extensionsUsed").append("VRMC_vrm")  # type: ignore[arg-type]
