"""The average of several people: a fictional face that moves as they do on average.

De-identification by averages of k faces is k-Same (Newton, Sweeney and Malin, IEEE TKDE 17(2), 2005), by averages of
appearance models k-Same-M (Gross, Sweeney, de la Torre and Baker, CVPR Workshops 2006).  Grid pixels; RGB 0..255.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from guise.aam.appearance import AppearanceModel, Components
from guise.aam.extrapolation import ReferenceMismatchError
from guise.aam.model import Identity, RestFrame
from guise.aam.tracker import Quality, Tracker
from guise.common.arrays import F32

BACKGROUND_GREY_LEVEL = 128.0  # around the face in the average's picture


def average(identities: Sequence[Identity], name: str) -> Identity:
    """The average of one or more people with the same reference frame.

    Its rest frame is the mean face on the reference grid.  Its tracker has no stages, as no picture shows the average.

    Raises
    ------
    ReferenceMismatchError
        When the reference frames differ.
    """
    first = identities[0]
    for other in identities[1:]:
        if other.reference.id != first.reference.id:
            raise ReferenceMismatchError(
                f"{first.name} and {other.name} cannot be averaged, they have different reference frames "
                f"({first.reference.resolution} and {other.reference.resolution} pixels across the face); "
                "enroll both with the same --resolution"
            )
    models = [identity.appearance for identity in identities]
    appearance = AppearanceModel(
        first.reference,
        average_components([model.components for model in models]),
        _mean([model.neutral for model in models]),
        np.mean([model.mask for model in models], axis=0) >= 0.5,
    )
    detail = _mean([identity.detail for identity in identities])
    facts = {"average_of": sorted(identity.name for identity in identities)}
    return Identity(name, appearance, _tracker(identities), detail, _rest_frame(appearance), facts)


def average_components(several: Sequence[Components]) -> Components:
    """Components of the mean covariance about the mean of the means, with as many modes as the largest has.

    With the scaled bases side by side, B = (Y_1 D_1, .., Y_K D_K) / sqrt K, that covariance is B B^T, whose
    eigenvectors B u / sigma come from those u of the small Gram matrix B^T B.
    """
    scaled = [c.basis * c.deviations for c in several]
    stacked = np.concatenate(scaled, axis=1) / np.float32(np.sqrt(len(several)))
    values, left = np.linalg.eigh((stacked.T @ stacked).astype(np.float64))
    most = max(c.modes for c in several)
    kept = np.argsort(-values)[: min(most, int((values > 1e-9 * max(values.max(), 1e-30)).sum()))]
    basis, _ = np.linalg.qr((stacked @ left[:, kept].astype(np.float32)).astype(np.float64))
    total = float(np.mean([c.total_variance for c in several]))
    deviations = np.sqrt(values[kept]).astype(np.float32)
    return Components(_mean([c.mean for c in several]), basis.astype(np.float32), deviations, total)


def _mean(arrays: Sequence[F32]) -> F32:
    return np.asarray(np.mean(arrays, axis=0, dtype=np.float64), np.float32)


def _tracker(identities: Sequence[Identity]) -> Tracker:
    """A tracker with the mean shapes that uses no pixels and corrects nothing."""
    trackers = [identity.tracker for identity in identities]
    quality = np.mean([(t.quality.error, t.quality.good, t.quality.bad) for t in trackers], axis=0)
    nothing = np.zeros(0, np.float32)
    empty = Components(nothing, np.zeros((0, 0), np.float32), nothing, 0.0)
    return Tracker(
        average_components([t.shapes for t in trackers]),
        (),
        empty,
        np.zeros(0, np.intp),
        Quality(*map(float, quality)),
        np.mean([t.box_to_shape for t in trackers], axis=0),
    )


def _rest_frame(model: AppearanceModel) -> RestFrame:
    """The mean face as a picture."""
    texture = model.reference.scatter(model.neutral_texture, BACKGROUND_GREY_LEVEL)
    return RestFrame(np.asarray(np.clip(texture, 0, 255).round(), np.uint8), model.reference.points)
