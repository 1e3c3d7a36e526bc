"""A face that is shown: all of it that is the same beside everybody."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from guise.aam.beard import beard
from guise.aam.even_light import evenly_lit
from guise.aam.irises import EYES
from guise.aam.landmarks.schemes import RIGID_WEIGHTS
from guise.aam.model import Identity
from guise.aam.similarity import align_planar
from guise.aam.solid_shape import SolidFit, SolidPrior
from guise.aam.turned_texture import completed, moving_share
from guise.aam.without_glasses import without_glasses
from guise.common.arrays import F32, F64


@dataclass(frozen=True, eq=False)
class Donor:
    """What is drawn of a face.

    Parameters
    ----------
    enrolled : Identity, as it is in its file.
    clean : the same in even light, without glasses, and with both halves where the clip shows one.
    beard : (h, w) share in [0, 1] of a beard.
    moving : (h, w) share in [0, 1] of its texture's movement that is shown.
    at_rest : (81, 2) its shape at rest, grid pixels.
    solid : SolidFit of that.
    eye_pixels : mean width of the eyes in the picture of the face at rest.
    across : (2,) grid pixels by which its texture shows what lies one face width farther back elsewhere.
    """

    enrolled: Identity
    clean: Identity
    beard: F32
    moving: F32
    at_rest: F64
    solid: SolidFit
    eye_pixels: float
    across: F64

    @classmethod
    def of(cls, identity: Identity) -> Donor:
        """Of a model, cleaned of what belongs to the clip that it was enrolled from; the last few are kept."""
        return _made(identity)


@lru_cache(maxsize=4)
def _made(identity: Identity) -> Donor:
    at_rest = identity.appearance.neutral_shape
    solid = SolidPrior.shipped().rest_of(at_rest, still=identity.knows_rest)
    to_grid = align_planar(at_rest, identity.reference.points, RIGID_WEIGHTS)
    across = np.asarray(solid.pose.linear[2] @ to_grid.linear)
    clean = evenly_lit(completed(without_glasses(identity)))
    eye_pixels = float(np.mean([np.ptp(identity.rest_frame.shape[eye][:, 0]) for eye in EYES]))
    hair, _ = beard(identity.rest_frame, identity.reference)
    return Donor(identity, clean, hair, moving_share(identity), at_rest, solid, eye_pixels, across)
