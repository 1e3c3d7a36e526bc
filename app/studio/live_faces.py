"""Whose face the page Live shows, and who is at the camera."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial

from guise.aam.model import Identity
from guise.aam.recognition import cosine_similarity, signature
from guise.app.drawing.donor import Donor
from guise.app.live.controls import Controls
from guise.app.live.options import LiveSettings
from guise.app.live.session import SessionConfig
from guise.app.people.kept import free_name
from guise.app.studio.dialogs import confirm
from guise.app.studio.site import Studio
from guise.app.swapping.donors import FIRST_NAMES, MODEL_SUFFIX, open_donor
from guise.common.errors import GuiseError

NOBODY = ""  # instead of a person's id: enrol
FACE = "live_face"  # the setting: whose face is shown first, chosen on the page People


class LiveCast:
    """The faces to choose from and the people who can be at the camera.

    Attributes
    ----------
    faces : spec -> name; the fictional ones come first, so that each keeps its key.
    controls : of the run; they hold which face is shown.
    enrolled : id of the person who has just been enrolled, or "".
    """

    def __init__(self, studio: Studio) -> None:
        self.studio, self.enrolled = studio, ""
        self.faces = dict(sorted(studio.faces().items(), key=lambda face: is_somebodys(face[0])))
        chosen = studio.store.setting(FACE)
        self._proposes = chosen not in self.faces  # nobody has chosen a face yet
        first = 0 if self._proposes else list(self.faces).index(chosen)
        real = (n for n, face in enumerate(self.faces) if is_somebodys(face) and n != first)
        self.controls = Controls(len(self.faces), LiveSettings(identity=first, mirror=True), real)
        self._asking = False  # whether a face of a real person may be shown

    @property
    def chosen(self) -> str:
        """The spec of the face that is shown."""
        return list(self.faces)[self.controls.settings.identity]

    @property
    def names(self) -> list[str]:
        """Of the faces, as the commands know them."""
        return [FIRST_NAMES.get(spec, name) for spec, name in self.faces.items()]

    def people(self) -> dict[str, str]:
        """Ids and names of the people who can be at the camera."""
        known = {person.id: person.name for person in self.studio.store.people()}
        return known | {NOBODY: "Enroll me (20 s)"}

    def session(self, person: str) -> SessionConfig:
        """Load the models for a person, or for somebody to be enrolled.  ModelError when one cannot be used."""
        faces = self._opened
        known = Identity.load(self.studio.store.person(person).path) if person else None
        return SessionConfig(faces, known, name="Me", keep=self._keep, meet=partial(self._propose, faces))

    def prepare(self) -> None:
        """Load what a first swap would wait for; a model that cannot be used is told of when the run begins."""
        with suppress(GuiseError):
            Donor.of(self._opened[self.controls.settings.identity])

    @cached_property
    def _opened(self) -> list[Identity]:
        return [Identity.load(face) if is_somebodys(face) else open_donor(face) for face in self.faces]

    async def choose(self, number: int) -> None:
        """Show a face; one that may be the user's own only after they agree."""
        if self.controls.asks_for(number) and not self._asking:
            self._asking, name = True, list(self.faces.values())[number]
            question = f"{name} is somebody who may be at the camera. Show that face, recognisable to anyone?"
            if await confirm(question, "Show this face", "Keep it hidden"):
                self.controls.agree(number)
            self._asking = False
        if 0 <= number < len(self.faces) and not self.controls.asks_for(number):
            self._proposes = False
            self.controls.change(identity=number)

    def _propose(self, faces: Sequence[Identity], person: Identity) -> None:
        """Unless the user has chosen, show another built-in face than the one that is most like the person's."""
        if self._proposes:
            able = [n for n, face in enumerate(self.faces) if not is_somebodys(face)]
            own = signature(person)
            most = max(able, key=lambda n: cosine_similarity(own, signature(faces[n])))
            self.controls.change(identity=next(n for n in able if n != most))

    def _keep(self, made: Identity) -> None:
        """Add a newly enrolled person to the studio's people; called in the run's processing thread."""
        person = self.studio.store.add_person(made.name, None)
        replace(made, name=free_name(made.name, person.path)).save(person.path)
        self.enrolled = person.id


def is_somebodys(face: str) -> bool:
    """Whether a face, given by its spec, is a real person's instead of a fictional one."""
    return face.endswith(MODEL_SUFFIX)
