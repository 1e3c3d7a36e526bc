"""The names of ARKit's 52 blend shapes, as Apple's documentation lists them.

ARFaceAnchor.BlendShapeLocation (developer.apple.com/documentation/arkit/arfaceanchor/blendshapelocation): a coefficient
is 0 at rest and 1 at its most; left and right are the person's.
"""

from __future__ import annotations

import re

_EYE = ("eyeBlink", "eyeLookDown", "eyeLookIn", "eyeLookOut", "eyeLookUp", "eyeSquint", "eyeWide")
_MOUTH_PAIRS = ("mouthSmile", "mouthFrown", "mouthDimple", "mouthStretch")
_LIP_PAIRS = ("mouthPress", "mouthLowerDown", "mouthUpperUp")


def _pairs(*names: str) -> tuple[str, ...]:
    return tuple(f"{name}{side}" for name in names for side in ("Left", "Right"))


ARKIT_NAMES: tuple[str, ...] = (
    *(f"{name}Left" for name in _EYE),
    *(f"{name}Right" for name in _EYE),
    "jawForward", "jawLeft", "jawRight", "jawOpen",
    "mouthClose", "mouthFunnel", "mouthPucker", "mouthLeft", "mouthRight",
    *_pairs(*_MOUTH_PAIRS),
    "mouthRollLower", "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper",
    *_pairs(*_LIP_PAIRS),
    "browDownLeft", "browDownRight", "browInnerUp", "browOuterUpLeft", "browOuterUpRight",
    "cheekPuff", "cheekSquintLeft", "cheekSquintRight", "noseSneerLeft", "noseSneerRight",
    "tongueOut",
)  # fmt: skip
INDEX: dict[str, int] = {name: index for index, name in enumerate(ARKIT_NAMES)}
FULL_LOOK_DEGREES = 30.0  # an eye's turn at which an eyeLook coefficient is 1; Apple gives no angle
_PLACES = {
    re.sub("(left|right)$", lambda side: f"_{side[0][0]}", name.lower()): k for name, k in INDEX.items()
}


def coefficient_of(name: str) -> int:
    """The coefficient that a morph target or an expression is called after, -1 for none.

    >>> coefficient_of("Face.EyeBlink_L") == coefficient_of("EyeBlinkLeft") == INDEX["eyeBlinkLeft"]
    True
    >>> coefficient_of("face.mouthPucker") == INDEX["mouthPucker"], coefficient_of("Smile")
    (True, -1)
    """
    bare = name.rpartition(".")[2].lower()
    plain = re.sub("_?(left|right|l|r)$", lambda side: f"_{side[1][0]}", bare)
    return _PLACES.get(plain, _PLACES.get(bare, -1))


def perfect_sync_name(name: str) -> str:
    """The name that Perfect Sync, the custom of VRM avatars with ARKit's shapes, has for one of them.

    >>> perfect_sync_name("jawOpen")
    'JawOpen'
    """
    return name[0].upper() + name[1:]
