"""A face fit for another's picture: as contrasty as theirs, and in the tone of their skin with nothing exaggerated.

Haze, flare and the curve of a camera lift what is dark in one clip more than in another.  But everybody's pupils and
lashes are black.  So of a face in which these are brighter than in another, and brighter against its skin, grey is
taken off its brightness until either is alike; of one in which they are darker, a little is added, as fair lashes are
not black.  Its colours stay: lips would become too red.

Light that is measured on skin holds the two skin tones as well, and dark skin on a fair face gets several times its
brightness: the tints of its cheeks and eye sockets become blotches, and dark lips grey or mauve.  The farther the tones
are apart, the less of the tints is kept, as the ideal swaps of `training/render_swaps.py` have it.  Tints are as strong
as the tone itself is coloured, by skin and camera: the folds of an orange face would be red lines on a pale one, so
that they fade with it.  Both faces as they were enrolled; grid pixels, RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from guise.aam.appearance import AppearanceModel
from guise.aam.irises import white
from guise.aam.landmarks.schemes import BROWS, INNER_LIPS, LEFT_EYE, LIPS, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, Bool
from guise.common.quantile import quantile
from guise.common.small import ramps


@dataclass(frozen=True)
class SkinToneLimits:
    """By how much two tones differ, and what follows from it."""

    eye_growth_face_widths: float = 0.02  # around the eyes, lashes included
    darkest_quantile: float = 0.02  # of the luma there: pupils and lashes
    stretch: tuple[float, float] = (0.9, 1.5)  # of differences from the skin, by which they become as dark
    alike: float = 0.11  # logarithm of brightness over brightness, up to which tones are alike
    easing: float = 3.3  # of tints, for each logarithm beyond
    around_face_widths: float = 0.15  # standard deviation of the means that hair is darker than
    lip_growth_face_widths: float = 0.01
    spread_face_widths: float = 0.01  # over which a change fades
    as_strong: float = 0.75  # ratio of how strongly two tones are coloured, below which tints are eased, too
    least_chroma: float = 0.05
    hair_darkness: tuple[float, float] = (0.2, 0.4)  # share darker than skin around: none is hair, all of it
    rim_face_widths: float = 0.15  # from the border, from which on all of the skin is the face's own
    rim_mean_face_widths: float = 0.04  # standard deviation of the means that go over into each other there
    shade_face_widths: float = 0.1  # standard deviation of the shades that are another's all over the face
    forehead_face_widths: float = 0.045  # over which a forehead is evened,
    least_skin: float = 0.02  # share of it that begins to tell
    rim_ratio: tuple[float, float] = (0.4, 2.5)  # of a channel


LIMITS = SkinToneLimits()
Shades = Literal["own", "colour", "all"]
BLACK = np.float32(4)  # grey levels, added before logarithms and ratios are taken


def toned(
    face: AppearanceModel, person: AppearanceModel, *, rim: F32 | None = None, shades: Shades = "own"
) -> AppearanceModel:
    """A face with a neutral texture fit for a person's contrast and skin tone.

    rim : (h, w) share in [0, 1] of bare skin in both, by which the face goes over into theirs at its border; None if
        it does not.
    shades : whether what is smooth in the person's is taken over: "own", nothing; "colour", their pallor and flush, on
        an even forehead; "all", brightness, too, which one photo alone does not tell from light.
    """
    reference = face.reference
    texture, other = (reference.scatter(one.neutral_texture) for one in (face, person))
    texture = with_even_forehead(texture, reference) if shades == "colour" else texture
    fit = in_tone_of(in_contrast_of(texture, other, reference), other, reference)
    fit = hair_in_light_of(fit, other, reference)
    if rim is not None and shades != "own":
        fit = in_shades_of(fit, other, rim, reference, bright=shades == "all")
    if rim is not None:
        fit = with_rim_of(fit, other, rim, reference)
    return face.with_neutral_texture(fit)


def with_even_forehead(texture: F32, reference: ReferenceFrame) -> F32:
    """A texture (h, w, 3) whose forehead is as bright at the temples as in the middle, where skin gleams.

    On dark skin that gloss is strong: drawn on fair skin it would be a bright forehead over a dark band.
    """
    above = np.arange(reference.size[0])[:, None] < reference.points[BROWS, 1].mean()
    skin, sigma = skin_mask(reference) & above, LIMITS.forehead_face_widths * reference.resolution
    logs = np.log(local_mean(texture, skin.astype(np.float32), sigma) @ LUMA)
    change = np.where(skin, logs[skin].mean() - logs, 0).astype(np.float32)
    near = cv2.GaussianBlur(skin.astype(np.float32), (0, 0), sigma)
    gain = np.exp(cv2.GaussianBlur(change, (0, 0), sigma) / (near + LIMITS.least_skin))
    return np.asarray(texture * gain[..., None], np.float32)


def in_contrast_of(texture: F32, other: F32, reference: ReferenceFrame) -> F32:
    """A neutral texture (h, w, 3) whose eyes are as dark against its skin as those of another."""
    eyes = soft_parts(reference, (RIGHT_EYE, LEFT_EYE), LIMITS.eye_growth_face_widths)[reference.mask] > 0.5
    skin = skin_mask(reference)[reference.mask]
    lumas = [one[reference.mask] @ LUMA for one in (texture, other)]
    tones = [float(luma[skin].mean()) for luma in lumas]
    dark = [quantile(luma[eyes], LIMITS.darkest_quantile) for luma in lumas]
    own, others = (1 - each / tone for each, tone in zip(dark, tones, strict=True))
    stretch = float(np.clip(others / max(own, 1e-3), *LIMITS.stretch))
    haze, by_level = tones[0] * (1 - 1 / stretch), dark[0] - dark[1]  # against the skin, and of whatever skin
    grey = np.sign(haze) * max(min(abs(haze), by_level * np.sign(haze)), 0.0)
    luma = np.maximum(texture @ LUMA, 1)[..., None]
    return np.asarray(texture * (np.maximum(luma - np.float32(grey), 1) / luma), np.float32)


def hair_in_light_of(texture: F32, other: F32, reference: ReferenceFrame) -> F32:
    """A neutral texture (h, w, 3) whose hair isn't bluer than the light on another, as the white of an eye shows it.

    Hair is grey to red in white light, and the ratio of two tones of skin knows nothing of it: beside reddish skin
    black brows would be violet.
    """
    skin = skin_mask(reference)
    seen = _over_black(texture)
    tone, other_tone = (_tone(one, skin) for one in (texture, other))
    light = white(other[soft_parts(reference, (RIGHT_EYE, LEFT_EYE), 0.0) > 0.5])
    to_light = other_tone / tone / light
    red, green, blue = np.moveaxis(seen * to_light, -1, 0)
    green = np.minimum(green, red)
    hair = np.stack([red, green, np.minimum(blue, green)], axis=-1) / to_light
    luma = seen @ LUMA
    hair *= (luma / (hair @ LUMA))[..., None]
    around = (
        local_mean(texture, skin.astype(np.float32), LIMITS.around_face_widths * reference.resolution) @ LUMA
    )
    share = ramps(1 - luma / around, *LIMITS.hair_darkness)
    share = share * (1 - soft_parts(reference, (LIPS,), LIMITS.lip_growth_face_widths))
    return np.asarray(texture + share[..., None] * (hair - seen), np.float32)


def in_tone_of(texture: F32, other: F32, reference: ReferenceFrame) -> F32:
    """A neutral texture (h, w, 3) fit for the skin tone of another; itself where tones are alike."""
    skin = skin_mask(reference)
    tone, other_tone = (_tone(one, skin) for one in (texture, other))
    apart = max(abs(float(np.log((other_tone @ LUMA) / (tone @ LUMA)))) - LIMITS.alike, 0.0)
    paler = _chroma(other_tone) / max(LIMITS.as_strong * _chroma(tone), LIMITS.least_chroma)
    if not apart and paler >= 1:
        return texture
    lips = soft_parts(reference, (LIPS,), LIMITS.lip_growth_face_widths)
    surface = np.where(skin | (lips > 0.5), 1 / (1 + LIMITS.easing * apart), 1).astype(np.float32)
    seen = _eased(texture, min(paler, 1.0) * surface, skin, reference)
    return np.asarray(seen - BLACK)


def with_rim_of(texture: F32, other: F32, bare: F32, reference: ReferenceFrame) -> F32:
    """A neutral texture (h, w, 3) whose skin goes over into that of another towards the border of the face.

    What is drawn ends there, and the other's skin goes on: in the same light no border is seen then.

    bare : (h, w) share in [0, 1] by which both have bare skin there.
    """
    ratio = _ratio(texture, other, bare, LIMITS.rim_mean_face_widths, reference)
    share = ramps(distance_inside(reference), 0.0, LIMITS.rim_face_widths).astype(np.float32)
    share = 1 - share * share * (3 - 2 * share)
    return np.asarray(_over_black(texture) * ratio ** share[..., None] - BLACK, np.float32)


def in_shades_of(
    texture: F32, other: F32, bare: F32, reference: ReferenceFrame, *, bright: bool = True
) -> F32:
    """A neutral texture (h, w, 3) with the smooth shades of another: gloss, flush and shadow go on beyond the face.

    bare : (h, w) share in [0, 1] by which both have bare skin there.
    bright : with their brightness, not colour alone.
    """
    ratio = _ratio(texture, other, bare, LIMITS.shade_face_widths, reference)
    if not bright:
        ratio = ratio / (ratio @ LUMA)[..., None]
    return np.asarray(_over_black(texture) * ratio - BLACK, np.float32)


def _ratio(texture: F32, other: F32, bare: F32, face_widths: float, reference: ReferenceFrame) -> F32:
    """(h, w, 3) smooth shades of another texture over those of one, each against its own tone.

    face_widths : standard deviation of the means.
    """
    skin = skin_mask(reference)
    weight = skin * bare
    means = [local_mean(one, weight, face_widths * reference.resolution) for one in (texture, other)]
    seen = weight[skin] / max(float(weight.sum()), 1e-6)
    tones = [np.exp(seen @ np.log(_over_black(one)[skin])) for one in (texture, other)]
    return np.asarray(np.clip(means[1] / means[0] * (tones[0] / tones[1]), *LIMITS.rim_ratio), np.float32)


def distance_inside(reference: ReferenceFrame) -> F32:
    """(h, w) distance from the border of the face, face widths."""
    border = np.pad(reference.mask, 1).astype(np.uint8)
    distance = cv2.distanceTransform(border, cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(distance / reference.resolution, np.float32)


def _tone(texture: F32, skin: Bool) -> F32:
    """(3,) over black: geometric mean of a texture's colours on skin (h, w)."""
    return np.asarray(np.exp(np.log(_over_black(texture)[skin]).mean(0)), np.float32)


def _chroma(tone: F32) -> float:
    """How strongly a tone (3,) is coloured: length of its channels' logarithms against its brightness."""
    return float(np.linalg.norm(np.log(tone / (tone @ LUMA))))


def _eased(texture: F32, share: F32, skin: Bool, reference: ReferenceFrame) -> F32:
    """A texture (h, w, 3), over black, that keeps a share (h, w) of its tints against its tone.

    Eyeballs and the inside of the mouth stay.

    skin : (h, w), where tints are measured.
    """
    seen = _over_black(texture)
    tone = _tone(texture, skin)
    surface = (soft_parts(reference, (RIGHT_EYE, LEFT_EYE, INNER_LIPS), 0.0) < 0.5).astype(np.float32)
    weight = cv2.GaussianBlur(surface, (0, 0), LIMITS.spread_face_widths * reference.resolution)[..., None]
    return np.asarray(seen + weight * (_with_tints(seen, tone, share) - seen), np.float32)


def _with_tints(seen: F32, tone: F32, share: F32) -> F32:
    """A texture (h, w, 3), over black, with a share (h, w) of its tints against a tone (3,), and its brightness."""
    luma = (seen @ LUMA)[..., None]
    tints = np.log(seen / tone * ((tone @ LUMA) / luma))
    eased = tone * np.exp(share[..., None] * tints)
    return np.asarray(eased * (luma / (eased @ LUMA)[..., None]), np.float32)


def local_mean(texture: F32, weight: F32, sigma: float) -> F32:
    """Means (h, w, 3) over black of a texture around each place, with weights (h, w)."""
    sums = cv2.GaussianBlur(texture * weight[..., None], (0, 0), sigma)
    weights = cv2.GaussianBlur(weight, (0, 0), sigma)[..., None]
    return np.asarray(sums / (weights + 1e-3) + BLACK, np.float32)


def _over_black(texture: F32) -> F32:
    """A texture as `local_mean` counts it."""
    return np.asarray(np.maximum(texture, 0) + BLACK, np.float32)
