"""A face that is shown: its model, cleaned once of what belongs to the clip that it was enrolled from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

from guise.aam.even_light import evenly_lit
from guise.aam.model import Identity
from guise.aam.skin_tone import toned
from guise.aam.turned_texture import completed, moving_share
from guise.aam.without_glasses import without_glasses
from guise.app.drawing.person import EnrolledFace
from guise.common.arrays import F32

_cleaned: WeakKeyDictionary[Identity, Donor] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Donor(EnrolledFace):
    """A face as it is drawn.

    identity : Identity.   moving : (h, w) share in [0, 1] of its texture's movement that is shown; None is all of it.
    """

    moving: F32 | None = None

    @classmethod
    def cleaned(cls, identity: Identity) -> Donor:
        """In even light, without glasses, and with both halves where the clip shows one; made once for each model."""
        if identity not in _cleaned:
            clean = evenly_lit(completed(without_glasses(identity)))
            _cleaned[identity] = cls(clean, moving_share(identity))
        return _cleaned[identity]

    def beside(self, person: Identity, *, own_lips: bool) -> Donor:
        """The same fit for a person's skin tone; own_lips : whether the lips lean to theirs."""
        return replace(self, identity=toned(self.identity, person, own_lips=own_lips))
