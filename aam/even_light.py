"""The light of a donor's own clip, taken out of their neutral face.

Who was enrolled beside a window has one bright and one dark half and a gleaming nose, and drawn into another scene
these look painted on.  A face is symmetric: smooth differences between its halves are light.  And people in even light
differ little in how nose, cheeks and forehead are shaded (`training/shading.py`): what is far beyond that is light,
too, and all the more in a face whose halves differ.  A beard, as the parsing tells it, stays dark.  What gleams on a
small scale gleams in that light, and the red of a nostril is that of light within; moles are darker than the skin
around them and stay.  Grid pixels; RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from guise.aam.beard import beard
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask
from guise.aam.mirror import mirror_image
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.skin_tone import BLACK, local_mean
from guise.common.arrays import F32

DATA = Path(__file__).parent / "data" / "shading.npz"


@dataclass(frozen=True)
class EvenLightLimits:
    """Scales and limits of what is taken for light."""

    symmetry_face_widths: float = 0.04  # standard deviation, over which both halves are compared
    shading_face_widths: float = 0.03  # over which shading is compared with that of other people
    # Over which shade lies in ordinary light, where what is finer is the form and the colour of one's own face, and in
    # hard light.
    spread_face_widths: tuple[float, float] = (0.07, 0.02)
    glint_spread_face_widths: float = 0.01  # the same for what gleams
    uneven: tuple[float, float] = (0.2, 0.35)  # logarithm between the halves: ordinary light, hard light
    free_deviations: tuple[float, float] = (1.5, 0.3)  # of others' shading, within which all is one's own
    soft_deviations: float = 0.75  # by which what is left lies farther out at most
    least_deviation: tuple[float, float, float] = (0.04, 0.01, 0.01)  # of luma, red and blue, logarithms
    gain: tuple[float, float] = (0.4, 2.5)  # of a channel
    glint_logarithm: float = 0.05  # by which a place gleams more than the skin around it at most
    chroma_logarithm: float = 0.08  # by which it is of another colour at most, either way
    beard_face_widths: float = 0.04  # standard deviation, over which a beard ends


LIMITS = EvenLightLimits()


def evenly_lit(identity: Identity) -> Identity:
    """The same person with a neutral texture as in even light, which gleams no more than in that."""
    texture = without_glints(even_texture(identity), identity.reference)
    return replace(identity, appearance=identity.appearance.with_neutral_texture(texture))


def even_texture(identity: Identity) -> F32:
    """(h, w, 3) the neutral texture as in even light."""
    reference = identity.reference
    texture = reference.scatter(identity.appearance.neutral_texture)
    hard = unevenness(texture, reference)
    free, spread = (
        float(np.interp(hard, LIMITS.uneven, ends))
        for ends in (LIMITS.free_deviations, LIMITS.spread_face_widths)
    )
    texture = symmetric(texture, reference)
    hair, _ = beard(identity.rest_frame, reference)
    return np.asarray(texture * _gain(texture, hair, reference, free, spread), np.float32)


def unevenness(texture: F32, reference: ReferenceFrame) -> float:
    """By how much the halves of a texture (h, w, 3) differ: root mean square of the logarithm between their lumas."""
    own, other, both = _halves(texture, reference)
    return float(np.sqrt((np.log((own @ LUMA) / (other @ LUMA))[both > 0] ** 2).mean()))


def symmetric(texture: F32, reference: ReferenceFrame) -> F32:
    """A texture (h, w, 3) whose local means are those of both halves of the face together."""
    own, other, both = _halves(texture, reference)
    gain = np.clip(np.sqrt(other / own), *LIMITS.gain)
    return np.asarray(texture * (1 + both[..., None] * (gain - 1)), np.float32)


def _halves(texture: F32, reference: ReferenceFrame) -> tuple[F32, F32, F32]:
    """Local means (h, w, 3) of a texture and of its mirror image, and where both are (h, w)."""
    image = mirror_image(texture, reference, 1)
    both = (reference.mask & (image.sum(2) > 0)).astype(np.float32)
    sigma = LIMITS.symmetry_face_widths * reference.resolution
    return local_mean(texture, both, sigma), local_mean(image, both, sigma), both


def shading(texture: F32, reference: ReferenceFrame) -> tuple[F32, F32]:
    """How a texture (h, w, 3) is shaded, and its local means, both (h, w, 3).

    Logarithms of luma, red over luma and blue over luma on skin, less their means over the face; 0 elsewhere.
    """
    skin = skin_mask(reference).astype(np.float32)
    local = local_mean(texture, skin, LIMITS.shading_face_widths * reference.resolution)
    luma = np.log(local @ LUMA)
    values = np.stack([luma, np.log(local[..., 0]) - luma, np.log(local[..., 2]) - luma], axis=-1)
    values -= (values * skin[..., None]).sum((0, 1)) / skin.sum()
    return np.asarray(values * skin[..., None]), local


def _gain(texture: F32, hair: F32, reference: ReferenceFrame, free: float, spread: float) -> F32:
    """(h, w, 3) factors that bring a texture's shading near to what people have in even light.

    hair : (h, w) share of a beard, which doesn't become brighter.
    free : deviations of other people's shading within which nothing is changed.
    spread : standard deviation over which a change is averaged, face widths.
    """
    mean, deviation = _usual(reference.resolution)
    values, local = shading(texture, reference)
    away = values - mean
    deviation = np.maximum(deviation, np.array(LIMITS.least_deviation, np.float32))
    soft = LIMITS.soft_deviations * deviation
    beyond = np.maximum(np.abs(away) - free * deviation, 0)
    change = np.sign(away) * (_softly(beyond, soft) - beyond)
    stays = cv2.GaussianBlur(hair, (0, 0), LIMITS.beard_face_widths * reference.resolution)
    change *= 1 - stays[..., None] * (change[..., :1] > 0)
    skin = skin_mask(reference).astype(np.float32)
    weight = cv2.GaussianBlur(skin, (0, 0), spread * reference.resolution) + LIMITS.spread_face_widths[1]
    luma, red, blue = np.moveaxis(
        cv2.GaussianBlur(change * skin[..., None], (0, 0), spread * reference.resolution) / weight[..., None],
        2,
        0,
    )
    lit = local * np.exp(np.stack([luma + red, luma, luma + blue], axis=-1))
    lit[..., 1] = np.exp(luma) * (local @ LUMA) - lit[..., [0, 2]] @ LUMA[[0, 2]]
    lit[..., 1] /= LUMA[1]
    return np.asarray(np.clip(lit / local, *LIMITS.gain), np.float32)


def without_glints(texture: F32, reference: ReferenceFrame) -> F32:
    """A texture (h, w, 3) whose skin gleams and is coloured only a little beyond its local means."""
    skin = skin_mask(reference).astype(np.float32)
    local = local_mean(texture, skin, LIMITS.shading_face_widths * reference.resolution)
    seen = np.maximum(texture, 0) + BLACK
    luma, local_luma = seen @ LUMA, local @ LUMA
    gleam = np.log(luma / local_luma)
    gleam = np.where(gleam > 0, _softly(gleam, LIMITS.glint_logarithm), gleam)
    chroma = np.log(seen / local * (local_luma / luma)[..., None])
    dull = local * np.exp(_softly(chroma, LIMITS.chroma_logarithm))
    dull *= (local_luma / (dull @ LUMA) * np.exp(gleam))[..., None]
    spread = cv2.GaussianBlur(skin, (0, 0), LIMITS.glint_spread_face_widths * reference.resolution)
    return np.asarray(texture + (skin * spread)[..., None] * (dull - seen), np.float32)


def _softly(values: F32, limit: F32 | float) -> F32:
    """Values within a limit, those near 0 as they are."""
    return np.asarray(limit * np.tanh(values / limit), np.float32)


@lru_cache(maxsize=4)
def _usual(resolution: int) -> tuple[F32, F32]:
    """Mean and standard deviation (h, w, 3) of shading over people in even light."""
    reference = ReferenceFrame.canonical(resolution)
    with np.load(DATA) as file:
        values, stored = file["shading"].astype(np.float32), ReferenceFrame.canonical(int(file["resolution"]))
    scale = stored.resolution / resolution
    to_stored = np.column_stack([np.eye(2) * scale, stored.points.min(0) - scale * reference.points.min(0)])
    h, w = reference.size
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    mean, deviation = (
        cv2.warpAffine(v, to_stored, (w, h), flags=flags, borderMode=cv2.BORDER_REPLICATE) for v in values
    )
    return np.asarray(mean, np.float32), np.asarray(deviation, np.float32)
