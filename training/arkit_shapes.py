"""ARKit's 52 blend shapes on the renderer's base mesh, made of its 34 sculpted units.

Where ARKit has a side, a unit is cut into two by a smooth mask whose halves add up to the whole, so that a unit moved
by the renderer is an exact sum of shapes here.  What no unit does (jaw forwards and aside, lips aside, rolled and
shrugged, cheeks, tongue) is procedural.  Decimetres, x to the person's left, y up, z forward; the mesh at rest is the
base before any target.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from guise.aam.landmarks.schemes import LIPS, LOWER_LIP_INNER
from guise.aam.rig.names import ARKIT_NAMES
from guise.common.arrays import F64, Bool

MIDLINE = 0.10  # half the width over which the two sides mix


def _both(shapes: dict[str, float]) -> dict[str, float]:
    """The same of both sides."""
    return {f"{name}{side}": share for name, share in shapes.items() for side in ("Left", "Right")}


# What the renderer's units are in ARKit's terms; those that nothing corresponds to are left out.
UNIT_SHAPES: dict[str, dict[str, float]] = {
    **{
        f"eye-{side}-{unit}": {f"{name}{side.capitalize()}": 1.0}
        for side in ("left", "right")
        for unit, name in (("closure", "eyeBlink"), ("opened-up", "eyeWide"), ("slit", "eyeSquint"))
    },
    **{
        f"eyebrows-{side}-{unit}": shapes
        for side in ("left", "right")
        for unit, shapes in (
            ("down", {f"browDown{side.capitalize()}": 1.0}),
            ("extern-up", {f"browOuterUp{side.capitalize()}": 1.0}),
            ("inner-up", {"browInnerUp": 0.5}),
            ("up", {f"browOuterUp{side.capitalize()}": 0.5, "browInnerUp": 0.25}),
        )
    },
    **{f"nose-{side}-elevation": {f"noseSneer{side.capitalize()}": 1.0} for side in ("left", "right")},
    "mouth-open": {"jawOpen": 1.0},
    "mouth-protusion": {"mouthFunnel": 1.0},
    "mouth-pursing": {"mouthPucker": 1.0},
    "mouth-eversion": {"mouthFunnel": 0.3},
    "mouth-upward-retraction": _both({"mouthUpperUp": 0.6, "mouthDimple": 0.8}),
    "neck-platysma": _both({"mouthStretch": 0.8}),
    "mouth-parling": _both({"mouthUpperUp": 0.4, "mouthLowerDown": 0.3}),
    **{
        f"mouth-{unit}": {f"{name}Left": 1.0, f"{name}Right": 1.0}
        for unit, name in (
            ("corner-puller", "mouthSmile"), ("depression", "mouthFrown"), ("retraction", "mouthDimple"),
            ("compression", "mouthPress"), ("depression-retraction", "mouthLowerDown"), ("elevation", "mouthUpperUp"),
        )
    },
}  # fmt: skip


def smooth(x: F64) -> F64:
    """From 0 to 1 without corners, of x in [0, 1]."""
    x = np.clip(x, 0, 1)
    return np.asarray(x * x * (3 - 2 * x))


class Face:
    """The places on the base mesh that the procedural shapes need.

    vertices : (n, 3) of the base.   points : (68, 3) iBUG on it.   units : displacements (n, 3) by the unit's name.
    lower_teeth, tongue : bool (n,), vertices of these helpers.   skin : bool (n,), of the body.
    """

    def __init__(
        self,
        vertices: F64,
        points: F64,
        units: Mapping[str, F64],
        lower_teeth: Bool,
        tongue: Bool,
        skin: Bool,
    ) -> None:
        self.vertices, self.units, self.tongue, self.skin = vertices, units, tongue, skin
        self.points = points
        opened = np.linalg.norm(units["mouth-open"], axis=1)
        inner = opened[skin][np.argmin(np.linalg.norm(vertices[skin] - points[LOWER_LIP_INNER], axis=1))]
        self.jaw = smooth(opened / max(inner, 1e-6))  # 1 on the chin and the lower lip, 0 on the upper one
        self.jaw[lower_teeth | tongue] = 1.0
        self.left = smooth((vertices[:, 0] + MIDLINE) / (2 * MIDLINE))
        lips = points[list(LIPS)]
        self.from_lips = np.linalg.norm(vertices[:, None] - lips[None], axis=2).min(1)

    def lips(self, reach: float) -> F64:
        """(n, 1): 1 on the lips, fading over `reach`."""
        return np.asarray(np.exp(-((np.maximum(self.from_lips - 0.03, 0) / reach) ** 2)) * self.skin)[:, None]

    def around(self, centre: tuple[float, float, float], reach: float) -> F64:
        """(n, 1): 1 at a place, fading over `reach`."""
        away = np.linalg.norm(self.vertices - centre, axis=1)
        return np.asarray(np.exp(-((away / reach) ** 2)) * self.skin)[:, None]


def shapes(face: Face) -> dict[str, F64]:
    """Displacements (n, 3) by ARKit's name, in its order; of eyeLook those of the lids, as eyeballs turn."""
    made = {**_eyes(face), **_jaw(face), **_lips(face), **_upper(face)}
    return {name: made[name] for name in ARKIT_NAMES}


def _eyes(face: Face) -> dict[str, F64]:
    found = {}
    for side in ("Left", "Right"):
        closure, wide, slit = (
            face.units[f"eye-{side.lower()}-{unit}"] for unit in ("closure", "opened-up", "slit")
        )
        falling, rising = (closure[:, 1:2] < 0) * closure, (slit[:, 1:2] > 0) * slit
        found |= {
            f"eyeBlink{side}": closure,
            f"eyeLookDown{side}": 0.3 * falling,
            f"eyeLookIn{side}": 0.0 * closure,
            f"eyeLookOut{side}": 0.0 * closure,
            f"eyeLookUp{side}": 0.6 * wide,
            f"eyeSquint{side}": slit,
            f"eyeWide{side}": wide,
            f"cheekSquint{side}": 0.5 * rising
            + face.around((0.36 if side == "Left" else -0.36, 7.02, 1.38), 0.2) * (0.0, 0.06, 0.02),
        }
    return found


def _jaw(face: Face) -> dict[str, F64]:
    jaw, opened = face.jaw[:, None], face.units["mouth-open"]
    tongue = np.zeros_like(face.vertices)
    z = face.vertices[face.tongue, 2]
    front = ((z - z.min()) / max(float(np.ptp(z)), 1e-6))[:, None]
    tongue[face.tongue] = (0, 0.02, 0.2) + front**1.5 * (0, -0.06, 0.42)
    lips = face.lips(0.1)
    return {
        "jawForward": jaw * (0, -0.01, 0.1),
        "jawLeft": jaw * (0.1, 0, 0),
        "jawRight": jaw * (-0.1, 0, 0),
        "jawOpen": opened,
        "mouthClose": lips * (-opened + (1 - jaw) * (0, -0.045, 0)),
        "tongueOut": tongue,
    }


def _lips(face: Face) -> dict[str, F64]:
    units, low = face.units, face.jaw[:, None]
    high, lips, near = 1 - low, face.lips(0.16), face.lips(0.07)
    wide = 0.8 * units["neck-platysma"] + 0.7 * units["mouth-retraction"] * (1, -0.3, 0.6)
    raised = 0.5 * units["mouth-elevation"] + 0.45 * units["mouth-upward-retraction"] * (0, 1, 0.4)
    lower_middle = face.around((0, 6.42, 1.53), 0.2)
    made = {
        "mouthFunnel": units["mouth-protusion"],
        "mouthPucker": units["mouth-pursing"],
        "mouthLeft": face.lips(0.25) * (0.11, 0, 0),
        "mouthRight": face.lips(0.25) * (-0.11, 0, 0),
        "mouthRollLower": low * near * (0, 0.03, -0.07),
        "mouthRollUpper": high * near * (0, -0.035, -0.06),
        "mouthShrugLower": low * np.maximum(0.8 * lips, lower_middle) * (0, 0.06, 0.03)
        + high * near * (0, 0.025, 0.01),
        "mouthShrugUpper": high * lips * (0, 0.02, 0.05),
    }
    for side, mask in (("Left", face.left[:, None]), ("Right", 1 - face.left[:, None])):
        made |= {
            f"mouthSmile{side}": mask * units["mouth-corner-puller"],
            f"mouthFrown{side}": mask * units["mouth-depression"],
            f"mouthDimple{side}": mask * units["mouth-retraction"],
            f"mouthStretch{side}": mask * wide,
            f"mouthPress{side}": mask * units["mouth-compression"],
            f"mouthLowerDown{side}": mask * low * units["mouth-depression-retraction"],
            f"mouthUpperUp{side}": mask * high * raised,
        }
    return {name: field * (face.skin[:, None]) for name, field in made.items()}


def _upper(face: Face) -> dict[str, F64]:
    units = face.units
    inner = units["eyebrows-left-inner-up"] + units["eyebrows-right-inner-up"]
    inner = inner + 0.5 * (units["eyebrows-left-up"] + units["eyebrows-right-up"])
    puffed = sum(face.around((x, 6.68, 1.22), 0.26) * (np.sign(x) * 0.16, 0, 0.08) for x in (0.42, -0.42))
    made = {"browInnerUp": inner, "cheekPuff": puffed + face.lips(0.1) * (0, 0, 0.02)}
    for side in ("left", "right"):
        brow, name = f"eyebrows-{side}", side.capitalize()
        made |= {
            f"browDown{name}": units[f"{brow}-down"],
            f"browOuterUp{name}": units[f"{brow}-extern-up"] + 0.5 * units[f"{brow}-up"],
            f"noseSneer{name}": units[f"nose-{side}-elevation"] + 0.5 * units["nose-compression"],
        }
    return made
