"""VRM's preset expressions as sums of ARKit's blend shapes, and how much of each a face shows.

VRM 1.0 leaves their look to the artist (vrm-specification, VRMC_vrm-1.0, expressions.md); this table is Guise's.
Left and right are the person's.
"""

from __future__ import annotations

import numpy as np

from guise.aam.rig.names import ARKIT_NAMES, INDEX
from guise.common.arrays import F64, Floating


def _both(**weights: float) -> dict[str, float]:
    """Weights of both sides."""
    return {f"{name}{side}": weight for name, weight in weights.items() for side in ("Left", "Right")}


PRESETS: dict[str, dict[str, float]] = {
    "aa": {"jawOpen": 0.6} | _both(mouthLowerDown=0.3, mouthUpperUp=0.2),
    "ih": {"jawOpen": 0.15} | _both(mouthStretch=0.5, mouthLowerDown=0.3, mouthUpperUp=0.2),
    "ou": {"jawOpen": 0.1, "mouthPucker": 0.8, "mouthFunnel": 0.2},
    "ee": {"jawOpen": 0.3} | _both(mouthSmile=0.3, mouthStretch=0.3, mouthLowerDown=0.2, mouthUpperUp=0.2),
    "oh": {"jawOpen": 0.4, "mouthFunnel": 0.7},
    "blink": _both(eyeBlink=1.0),
    "blinkLeft": {"eyeBlinkLeft": 1.0},
    "blinkRight": {"eyeBlinkRight": 1.0},
    "happy": _both(mouthSmile=0.8, cheekSquint=0.6, eyeSquint=0.4),
    "angry": {"mouthShrugLower": 0.3} | _both(browDown=1.0, noseSneer=0.5, eyeSquint=0.3, mouthFrown=0.4),
    "sad": {"browInnerUp": 1.0, "mouthShrugLower": 0.4} | _both(mouthFrown=0.8),
    "relaxed": _both(mouthSmile=0.3, eyeSquint=0.3, eyeBlink=0.2),
    "surprised": {"browInnerUp": 0.8, "jawOpen": 0.3} | _both(browOuterUp=1.0, eyeWide=1.0),
    "lookUp": _both(eyeLookUp=1.0),
    "lookDown": _both(eyeLookDown=1.0),
    "lookLeft": {"eyeLookOutLeft": 1.0, "eyeLookInRight": 1.0},
    "lookRight": {"eyeLookInLeft": 1.0, "eyeLookOutRight": 1.0},
    "neutral": {},
}
SHOWN = tuple(name for name in PRESETS if name not in ("blink", "relaxed", "neutral"))  # told apart in a face


def preset_values(weights: Floating) -> dict[str, float]:
    """How much of each preset of `SHOWN`, from 0 to 1, together come closest to coefficients (52,).

    >>> made = np.zeros(52)
    >>> made[[INDEX[name] for name in PRESETS["happy"]]] = list(PRESETS["happy"].values())
    >>> {name: round(value, 3) for name, value in preset_values(made).items() if value > 1e-9}
    {'happy': 1.0}
    """
    from scipy.optimize import nnls

    found, _ = nnls(_MATRIX, np.asarray(weights, np.float64))
    return dict(zip(SHOWN, np.minimum(found, 1.0).tolist(), strict=True))


def _matrix() -> F64:
    found = np.zeros((len(ARKIT_NAMES), len(SHOWN)))
    for column, name in enumerate(SHOWN):
        for shape, weight in PRESETS[name].items():
            found[INDEX[shape], column] = weight
    return found


_MATRIX = _matrix()
