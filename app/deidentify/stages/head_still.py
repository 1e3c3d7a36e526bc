"""The stills of heads that are drawn in place of others, with the share of each pixel that is the head.

Those of the fictional people were path traced with hair of strands and a transparency of their own
(`training/render_heads.py`); anybody else's is cut out of the frame of their enrolment, as `head_matte` tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources

import cv2
import numpy as np

from guise.aam.mask import beyond_mask
from guise.aam.parsing import HeadParser
from guise.app.deidentify.stages.head_matte import HeadPlaces, matte
from guise.app.swapping.donors import fictional, open_donor
from guise.common.arrays import F32, F64, U8

HEADS = resources.files("guise.app").joinpath("gallery", "heads")
SURE_SHARE = 0.9  # of the head in a pixel of a still that was cut out, from which its colour is the head's,
TRACED_SHARE = 0.35  # and in one that was path traced
HAIR_MARGIN = 0.55  # by which hair's share must be larger where what is behind it is not drawn
WHOLE_LEVELS = 14, 244  # of hair in the file, that are none and whole
MIN_BEFORE = 0.01  # of a face behind hair
BLUR = 0.4  # standard deviation in pixels of the frame, below which strands would flicker


@dataclass(frozen=True, eq=False)
class HeadStill:
    """A head from the front.

    picture : (h, w, 3) RGB, without background.   alpha : (h, w) share of the head.   shape : (81, 2), pixels.
    before : (h, w) 255ths of hair that hangs before the face; None if there is none.
    """

    picture: U8
    alpha: F32
    shape: F64
    before: U8 | None = None

    @classmethod
    def of(cls, spec: str) -> HeadStill:
        """Of a donor's spec; see `open_donor` for what it raises."""
        name = fictional(spec)
        if name is not None and HEADS.joinpath(f"{name}.webp").is_file():
            return cls.shipped(name)
        still = open_donor(spec).rest_frame
        alpha = matte(HeadParser(), still)
        return cls(without_background(still.picture, alpha, SURE_SHARE), alpha, still.shape)

    @classmethod
    def shipped(cls, name: str) -> HeadStill:
        """Of a fictional person: colours and alpha above, the hair that nothing hides below them."""
        with resources.as_file(HEADS.joinpath("points.npz")) as path, np.load(path) as points:
            shape = points[name].astype(np.float64)
        stored = np.frombuffer(HEADS.joinpath(f"{name}.webp").read_bytes(), np.uint8)
        both: U8 = np.asarray(cv2.imdecode(stored, cv2.IMREAD_UNCHANGED), np.uint8)
        traced, (grey, *_) = both[: len(both) // 2], np.moveaxis(both[len(both) // 2 :], 2, 0)
        least, most = WHOLE_LEVELS  # as the file is not without loss
        share = np.asarray(np.clip((grey.astype(np.float32) - least) / (most - least), 0, 1), np.float32)
        places = HeadPlaces(shape, np.ones(share.shape, np.bool_))
        skin = traced[..., 3] / np.float32(255) * places.ends(np.zeros_like(share))
        alpha = np.maximum(skin, share)
        alpha *= places.ends(np.ones_like(share))
        hangs = (share * places.face).sum() > MIN_BEFORE * places.face.sum()
        # Ends of hair below the jaw have been traced before a neck and shoulders that are not drawn.
        sure = np.where(
            skin > SURE_SHARE, skin, np.where(places.below_jaw | places.low, share - HAIR_MARGIN, alpha)
        )
        picture = without_background(np.ascontiguousarray(traced[..., 2::-1]), sure, TRACED_SHARE)
        return cls(picture, alpha, shape, np.asarray(share * 255, np.uint8) if hangs else None)

    def seen(self, smaller: float) -> tuple[U8, F32]:
        """Picture and alpha as they are drawn smaller by a factor: strands finer than its pixels are their mean."""
        if smaller <= 1:
            return self.picture, self.alpha
        sigma = BLUR * np.sqrt(smaller**2 - 1)
        alpha = np.asarray(cv2.GaussianBlur(self.alpha, (0, 0), sigma), np.float32)
        return np.asarray(cv2.GaussianBlur(self.picture, (0, 0), sigma), np.uint8), alpha


def without_background(picture: U8, alpha: F32, sure: float) -> U8:
    """A still (h, w, 3) in which what isn't wholly head has the colour of the head beside it: no halo surrounds it."""
    made = picture.reshape(-1, 3).copy()
    beside, nearest = beyond_mask(alpha > sure)
    made[beside] = made[nearest]
    return made.reshape(picture.shape)
