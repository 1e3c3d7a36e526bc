"""Donors: whose face a person gets, chosen without looking at the person.

A donor is given by its spec: ``p03``, a person of the gallery that ships with Guise; ``NAME.guise``, a model of the
user's own; ``NAME.jpg``, a photo of somebody; ``mean:p01+p04`` or ``mean:A.guise+B.guise``, the average of several.
Users see and may give first names instead of the gallery's numbers: ``Mei`` is ``p03``.

A key file remembers people and their donors, so that a person keeps a donor from video to video.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from importlib import resources
from itertools import count, repeat
from math import comb
from pathlib import Path
from typing import Any

import numpy as np

from guise.aam.averaging import average
from guise.aam.model import Identity, ModelError
from guise.aam.recognition import MIN_SAME_PERSON_SIMILARITY, SIGNATURE_LENGTH, cosine_similarity, signature
from guise.app.media.file_kind import has_image_name
from guise.app.people.kept import KeptPerson, PeopleError, everybody, rename
from guise.common.arrays import F32
from guise.common.files import write_whole

MEAN_PREFIX = "mean:"
SAME, AVERAGE_PREFIX = "same", "average:"  # one donor for all people of all videos
MODEL_SUFFIX = ".guise"
COMMON_FACES = (
    "p01",
    "p06",
)  # faces that a recogniser finds similar to many others, so they hide a person less well
FIRST_NAMES = {  # of the people of the gallery, for users
    "p01": "Luca", "p02": "Amara", "p03": "Mei", "p04": "Walter", "p05": "Kofi", "p06": "Elena", "p07": "Kenji",
    "p08": "Asha", "p09": "Omar",
}  # fmt: skip
KEY_FILE_FORMAT, KEY_FILE_VERSION = "guise-key", 1


class DonorError(ModelError):
    """Donors that cannot be used as requested."""


@lru_cache(maxsize=1)
def gallery() -> tuple[str, ...]:
    """Names of the donors that ship with Guise: rendered, fictional people (docs/gallery.md)."""
    names = (entry.name for entry in resources.files("guise.app").joinpath("gallery").iterdir())
    return tuple(sorted(name.removesuffix(MODEL_SUFFIX) for name in names if name.endswith(MODEL_SUFFIX)))


@lru_cache(maxsize=2)  # a dozen megabytes each, and a long video shows many
def open_donor(spec: str) -> Identity:
    """The donor of a spec, cached.

    Raises
    ------
    DonorError, ModelError
        When it does not exist or its file cannot be used.
    ReferenceMismatchError
        When people with different reference frames are to be averaged.
    """
    if spec.startswith(MEAN_PREFIX):
        return average([open_donor(part) for part in parts(spec)], spec)
    if (id := fictional(spec)) is not None:
        with _gallery_file(id) as path:
            return replace(Identity.load(path), name=FIRST_NAMES[id])
    if spec.endswith(MODEL_SUFFIX):
        return Identity.load(spec)
    if is_photo(spec):
        from guise.app.enrolment.photo import person_of_photo  # which models need not

        return person_of_photo(Path(spec), anybody())
    raise DonorError(
        f"there is no donor {spec}; use NAME.guise, a photo, or one of {', '.join(FIRST_NAMES.values())}"
    )


def is_photo(spec: str) -> bool:
    """Whether a spec is the file of a picture."""
    return has_image_name(Path(spec)) and Path(spec).is_file()


def anybody() -> Identity:
    """The average of the gallery: how a face moves of which nothing but a photo is known."""
    return open_donor(MEAN_PREFIX + "+".join(gallery()))


def _gallery_file(id: str) -> AbstractContextManager[Path]:
    return resources.as_file(resources.files("guise.app").joinpath("gallery", id + MODEL_SUFFIX))


def fictional(spec: str) -> str | None:
    """The spec of a person of the gallery given by that, or by first name in any case; None if it is nobody there.

    >>> fictional("p03"), fictional("mei"), fictional("mine.guise")
    ('p03', 'p03', None)
    """
    return next((id for id, name in FIRST_NAMES.items() if spec == id or spec.lower() == name.lower()), None)


def titled(spec: str) -> str:
    """A donor as users know it: by first name where it is fictional, and without folders.

    >>> titled("p03"), titled("mean:p01+p04"), titled("/home/ann/mine.guise")
    ('Mei', 'the average of Luca and Walter', 'mine.guise')
    """
    names = [FIRST_NAMES.get(fictional(part) or "", Path(part).name) for part in parts(spec)]
    return names[0] if len(names) == 1 else f"the average of {', '.join(names[:-1])} and {names[-1]}"


def open_face(face: str) -> Identity:
    """The model of the face that a user names, see `face_spec`.

    Raises
    ------
    DonorError, ModelError
        When there is none, or its file cannot be used.
    """
    spec = face_spec(face)
    kept = spec != face and spec.endswith(MODEL_SUFFIX)
    return Identity.load(spec) if kept else open_donor(spec)


def face_spec(face: str) -> str:
    """The donor's spec, as for `open_donor`, of a face that a user names: a spec, or the name of somebody who is kept.

    Somebody who is kept comes before a fictional person of the same first name.

    Raises
    ------
    DonorError
        When there is none.
    """
    path = Path(face)
    if face.startswith(MEAN_PREFIX) or path.suffix == MODEL_SUFFIX or is_photo(face):
        return face
    if path.is_file():
        raise DonorError(
            f"{face} is not a model of a face: make one from it with: guise enroll {face} -o {path.stem}{MODEL_SUFFIX}"
        )
    people = {} if face in gallery() else {person.name: person.path for person in everybody()}
    if face in people:
        return str(people[face])
    if (id := fictional(face)) is None:
        raise DonorError(
            f"there is no face {face}: give NAME{MODEL_SUFFIX}, a photo, or one of "
            f"{', '.join([*FIRST_NAMES.values(), *people])}"
        )
    return id


def rename_kept(name: str, new: str) -> KeptPerson:
    """Give somebody who is kept another name.  PeopleError when it is taken, or there is no such person."""
    if new.strip() in gallery():
        raise PeopleError(f"{new.strip()} is a face of the gallery: choose another name")
    return rename(name, new)


@contextmanager
def face_file(face: str) -> Iterator[Path]:
    """The model file of the face that a user names, as for `face_spec`, within a `with` block."""
    spec = face_spec(face)
    if is_photo(spec):
        raise DonorError(
            f"{face} is not a model of a face: make one from it with: guise enroll {face} -o "
            f"{Path(face).stem}{MODEL_SUFFIX}"
        )
    if (id := fictional(spec)) is None:
        yield Path(spec)
        return
    with _gallery_file(id) as path:
        yield path


def parts(spec: str) -> list[str]:
    """The specs of which a spec is the average; a path may hold a plus sign.

    >>> parts("mean:p01+a+b.guise"), parts("mine.guise")
    (['p01', 'a+b.guise'], ['mine.guise'])
    """
    if not spec.startswith(MEAN_PREFIX):
        return [spec]
    found: list[str] = []
    for piece in spec.removeprefix(MEAN_PREFIX).split("+"):
        whole = not found or fictional(found[-1]) is not None or found[-1].endswith(MODEL_SUFFIX)
        found = [*found, piece] if whole else [*found[:-1], f"{found[-1]}+{piece}"]
    return found


def bare(spec: str) -> str:
    """A spec without folders, which might reveal who made a model.

    >>> bare("/home/ann/mine.guise"), bare("mean:p01+b/c.guise")
    ('mine.guise', 'mean:p01+c.guise')
    """
    return MEAN_PREFIX * spec.startswith(MEAN_PREFIX) + "+".join(Path(part).name for part in parts(spec))


def assign(
    people: Sequence[int], donor: str, *, own: Sequence[Path] = (), seed: int, salt: str,
    known: Mapping[int, str] | None = None, taken: Collection[str] = (),
) -> dict[int, str]:  # fmt: skip
    """The spec of each person's donor, which depends on the arguments only, never on what a person looks like.

    Parameters
    ----------
    people : numbers of the people of a video.
    donor : "auto", a donor for each: single ones, then averages of two, of three ..; "mean:K", an average of K for
        each, as in k-Same-M (`guise.aam.averaging`), but none of them includes the person's own face; "same" or
        "average:K", one donor or the average of K for everybody, whatever the salt, so that a donor tells nobody from
        the others who have it; or a spec, for everybody.
    own : models that replace the gallery.
    seed, salt : determine the order; the salt is the video's name, so that not every video starts with the same donor.
    known : donors that some people already have.
    taken : donors that nobody else should get.

    Donors are distinct as long as there are enough; then they repeat.

    Raises
    ------
    DonorError
        When K is larger than the number of donors.
    """
    if (shared := _shared(donor, _names(own), seed)) is not None:
        return dict.fromkeys(people, shared)
    fixed = {person: spec for person, spec in (known or {}).items() if person in people}
    order = _endless(donor, _names(own), seed, salt, {*fixed.values(), *taken})
    return {person: fixed[person] if person in fixed else next(order) for person in people}


def heads_for(
    faces: Mapping[int, str], asked: str, *, own: Sequence[Path] = (), seed: int, salt: str
) -> dict[int, str]:  # fmt: skip
    """By person, the spec of the single donor whose head, with its hair, goes about an assigned face.

    By lot, of somebody else, and each of a video another while there are enough: with faces and heads drawn apart there
    are many more people to be, and two takes of a person are linked less often.  Somebody whom the user named keeps
    their own head; an average has none.

    faces : by person, the spec that was assigned.   asked, own, seed : as for `assign`.
    salt : the video's name; "" if a face has the same head in all videos.
    """
    names, given = _names(own), {}
    everywhere = not salt or _shared(asked, names, seed) is not None
    for person, face in sorted(faces.items()):
        if face == asked and len(parts(face)) == 1:
            given[person] = face
            continue
        lot = "" if everywhere else f"{salt} {person}"
        order = sorted(names, key=lambda name: _digest(seed, lot, "head", face, Path(name).name))
        others = [name for name in order if name not in parts(face)] or order
        free = [name for name in others if everywhere or name not in given.values()]
        given[person] = (free or others)[0]
    return given


def _shared(donor: str, names: Sequence[str], seed: int) -> str | None:
    """The donor that all people of all videos share, if that is what is asked for."""
    if donor != SAME and not donor.startswith(AVERAGE_PREFIX):
        return None
    size = 1 if donor == SAME else _size(donor, AVERAGE_PREFIX, len(names))
    return next(_subsets(names, size, seed, ""))


def _names(own: Sequence[Path]) -> tuple[str, ...]:
    wrong = [path for path in own if path.suffix != MODEL_SUFFIX and fictional(str(path)) is None]
    if wrong:
        raise DonorError(
            f"a donor is a file NAME{MODEL_SUFFIX} or a fictional face, got {wrong[0]}; make one with: "
            "guise enroll VIDEO"
        )
    return tuple(dict.fromkeys(map(str, own))) or gallery()


def _endless(
    donor: str, names: Sequence[str], seed: int, salt: str, taken: Collection[str]
) -> Iterator[str]:  # fmt: skip
    """Specs in the order in which they are assigned, then again from the first."""
    sizes = _sizes(donor, len(names))
    if not sizes:
        yield from repeat(donor)
    yield from (spec for size in sizes for spec in _subsets(names, size, seed, salt) if spec not in taken)
    while True:
        yield from (spec for size in sizes for spec in _subsets(names, size, seed, salt))


def _sizes(donor: str, most: int) -> range:
    """Numbers of donors that are averaged, in order; empty when the donor is a spec."""
    if donor == "auto":
        return range(1, most + 1)
    if not donor.startswith(MEAN_PREFIX) or not donor.removeprefix(MEAN_PREFIX).isdigit():
        return range(0)
    size = _size(donor, MEAN_PREFIX, most)
    return range(size, size + 1)


def _size(donor: str, prefix: str, most: int) -> int:
    """The K of "mean:K" or "average:K"; DonorError unless it is 1 to `most`."""
    text = donor.removeprefix(prefix)
    if not text.isdigit() or not 1 <= int(text) <= most:
        raise DonorError(f"{donor} averages {text} donors, but there are {most}; choose 1 to {most}")
    return int(text)


def _subsets(names: Sequence[str], size: int, seed: int, salt: str) -> Iterator[str]:
    """Every subset of a size once, as a spec, in an order given by SHA-256; of single donors COMMON_FACES come last."""
    if size == 1:
        yield from sorted(
            names, key=lambda name: (name in COMMON_FACES, _digest(seed, salt, Path(name).name))
        )
        return
    seen: set[str] = set()
    for draw in count():
        if len(seen) == comb(len(names), size):
            return
        order = sorted(names, key=lambda name: _digest(seed, salt, size, draw, Path(name).name))
        spec = MEAN_PREFIX + "+".join(sorted(order[:size]))
        if spec not in seen:
            seen.add(spec)
            yield spec


def _digest(*values: object) -> bytes:
    return hashlib.sha256(repr(values).encode()).digest()


@dataclass(frozen=True)
class KnownPerson:
    """A person of a key file: name, spec of the donor, signature (64,) of the face."""

    name: str
    donor: str
    signature: tuple[float, ...]


class KeyFile:
    """People and their donors, so that a person gets the same donor in every video.

    The file holds biometric data (by which a person can be found in other pictures), and it links outputs to people:
    whoever has it can undo part of the de-identification.  It is readable by its owner only; keep it apart from the
    outputs and delete it when it is no longer needed.  Its secret seed replaces a public one, so that nobody without
    the file can tell who would have got which donor.

    Every change re-reads the file and rewrites it, under a lock.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seed, self.people = _read_key(path)

    @classmethod
    def open(cls, path: Path) -> KeyFile:
        """Read a key file; a new one is made if it doesn't exist.

        Raises DonorError when it is damaged or isn't a key file.
        """
        with _locked(path):
            if not path.exists():
                _write_key(path, secrets.randbits(64), ())
            return cls(path)

    def recognise(self, identity: Identity) -> KnownPerson | None:
        """Who of the file an enrolled person is, or None; see `guise.aam.recognition`."""
        return self._like(signature(identity))

    def remember(self, name: str, donor: str, identity: Identity) -> KnownPerson:
        """Add a person, unless another process has added them in the meantime.

        name : "" for the next number.
        """
        with _locked(self.path):
            return self._remembered(name, donor, signature(identity))

    def assign(
        self, people: Mapping[int, F32 | None], donor: str, *, own: Sequence[Path] = (), salt: str,
        taken: Collection[str] = (),
    ) -> dict[int, str]:  # fmt: skip
        """As `assign`: known people keep their donors, the others get donors that nobody in the file has yet.

        people : the signature (64,) of each person of a video, or None; those who have one are remembered.
        taken : donors that these people should not get; who has one gets another for good.
        """
        faces = {person: face for person, face in people.items() if face is not None}
        with _locked(self.path):
            self.seed, self.people = _read_key(self.path)
            if taken:
                refused = [self._like(face) for face in faces.values()]
                kept = [one for one in self.people if one not in refused or one.donor not in taken]
                _write_key(self.path, self.seed, tuple(kept))
                self.people = tuple(kept)
            found = {person: self._like(face) for person, face in faces.items()}
            known = {person: entry.donor for person, entry in found.items() if entry is not None}
            taken = {*taken, *(entry.donor for entry in self.people)}
            donors = assign(list(people), donor, own=own, seed=self.seed, salt=salt, known=known, taken=taken)
            for person in faces.keys() - known.keys():
                self._remembered("", donors[person], faces[person])
        return donors

    def _like(self, face: F32) -> KnownPerson | None:
        best = max(self.people, key=lambda entry: _similarity(entry, face), default=None)
        return best if best is not None and _similarity(best, face) >= MIN_SAME_PERSON_SIMILARITY else None

    def _remembered(self, name: str, donor: str, face: F32) -> KnownPerson:
        self.seed, self.people = _read_key(self.path)
        known = self._like(face)
        if known is None:
            values = tuple(round(float(v), 5) for v in face)
            known = KnownPerson(name or f"person {len(self.people) + 1}", donor, values)
            self.people = (*self.people, known)
            _write_key(self.path, self.seed, self.people)
        return known


def _similarity(entry: KnownPerson, face: F32) -> float:
    return cosine_similarity(np.array(entry.signature, np.float32), face)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock on the folder of a key file, so that one process at a time changes it."""
    import fcntl

    folder = os.open(path.absolute().parent, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def _write_key(path: Path, seed: int, people: Sequence[KnownPerson]) -> None:
    entries = [asdict(person) for person in people]
    text = json.dumps(
        {"format": KEY_FILE_FORMAT, "version": KEY_FILE_VERSION, "seed": seed, "people": entries}
    )

    def write(part: Path) -> None:
        part.unlink(missing_ok=True)
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())

    write_whole(path, write)


def _read_key(path: Path) -> tuple[int, tuple[KnownPerson, ...]]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        form, version = content["format"], content["version"]
    except (ValueError, KeyError, TypeError) as error:
        raise DonorError(
            f"{path} isn't a key file or is damaged: use a backup of it, or another name"
        ) from error
    if (form, version) != (KEY_FILE_FORMAT, KEY_FILE_VERSION):
        raise DonorError(
            f"{path} is {form} of version {version}, expected {KEY_FILE_FORMAT} of version {KEY_FILE_VERSION}: "
            "use another name"
        )
    try:
        return int(content["seed"]), tuple(_known_person(entry) for entry in content["people"])
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise DonorError(f"{path} is damaged ({error}): use a backup of it, or another name") from error


def _known_person(entry: dict[str, Any]) -> KnownPerson:
    face = tuple(float(value) for value in entry["signature"])
    if len(face) != SIGNATURE_LENGTH or not np.isfinite(face).all():
        raise ValueError(f"a signature of {len(face)} values instead of {SIGNATURE_LENGTH}")
    return KnownPerson(str(entry["name"]), str(entry["donor"]), face)
