"""A person who is tracked, in whose place a face is drawn."""

from __future__ import annotations

from dataclasses import dataclass

from guise.aam.irises import Irises
from guise.aam.model import Identity
from guise.aam.parameters import ParameterEstimator
from guise.aam.solid_shape import SolidFit, SolidPrior
from guise.common.arrays import F32, F64, Bool, Int


@dataclass(frozen=True, eq=False)
class TrackedPerson:
    """What is known of them.

    identity : Identity.   estimator : of the parameters of their appearance.
    """

    identity: Identity
    estimator: ParameterEstimator

    @classmethod
    def of(cls, identity: Identity, resolution: int) -> TrackedPerson:
        """From their model, with so many grid pixels across the face."""
        fitting = identity.at_resolution(resolution)
        return cls(fitting, ParameterEstimator(fitting.appearance))

    @property
    def texels(self) -> Int:
        """(t,) the mask pixels at which light and expression are measured."""
        return self.estimator.texels

    @property
    def mask(self) -> Bool:
        """(h, w) where their face may be shown."""
        return self.identity.appearance.mask

    @property
    def at_rest(self) -> F64:
        """(81, 2) their shape at rest, grid pixels."""
        return self.identity.appearance.neutral_shape

    @property
    def texture(self) -> F32:
        """(n, 3) their RGB at rest."""
        return self.identity.appearance.neutral_texture

    @property
    def irises(self) -> Irises:
        """Theirs at rest."""
        return Irises.at_rest(self.identity.reference, self.at_rest, self.texture)

    @property
    def solid(self) -> SolidFit:
        """Of their shape at rest."""
        return SolidPrior.shipped().rest_of(self.at_rest, still=self.identity.knows_rest)
