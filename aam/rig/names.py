"""The names of ARKit's 52 blend shapes, as Apple's documentation lists them.

ARFaceAnchor.BlendShapeLocation (developer.apple.com/documentation/arkit/arfaceanchor/blendshapelocation): a coefficient
is 0 at rest and 1 at its most; left and right are the person's.
"""

from __future__ import annotations

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
