"""Donors: whose face a person gets, chosen without a look at the person.

A donor is told by its spec: ``p03``, a person of the gallery that ships with Guise; ``NAME.guise``, a model of the
user's own; ``mean:p01+p04`` or ``mean:A.guise+B.guise``, the average of several.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import lru_cache
from importlib import resources
from itertools import count, repeat
from math import comb
from pathlib import Path

from aam.averaging import average
from aam.model import Identity, ModelError

MEAN = "mean:"
SUFFIX = ".guise"


class DonorError(ModelError):
    """Donors that cannot be used as asked; one sentence."""


@lru_cache(maxsize=1)
def gallery() -> tuple[str, ...]:
    """Names of the donors that ship with Guise: rendered people who do not exist (docs/gallery.md)."""
    names = (entry.name for entry in resources.files("app").joinpath("gallery").iterdir())
    return tuple(sorted(name.removesuffix(SUFFIX) for name in names if name.endswith(SUFFIX)))


@lru_cache(maxsize=8)
def open_donor(spec: str) -> Identity:
    """The donor of a spec, kept for the next time.

    Raises
    ------
    DonorError, ModelError
        When it does not exist or its file cannot be used.
    ReferenceMismatchError
        When people with different reference frames are to be averaged.
    """
    if spec.startswith(MEAN):
        return average([open_donor(part) for part in parts(spec)], spec)
    if spec in gallery():
        with resources.as_file(resources.files("app").joinpath("gallery", spec + SUFFIX)) as path:
            return Identity.load(path)
    if not spec.endswith(SUFFIX):
        raise DonorError(f"there is no donor {spec}; use NAME.guise, or one of {', '.join(gallery())}")
    return Identity.load(spec)


def parts(spec: str) -> list[str]:
    """The specs of which a spec is the average; a path may hold a plus sign.

    >>> parts("mean:p01+a+b.guise"), parts("mine.guise")
    (['p01', 'a+b.guise'], ['mine.guise'])
    """
    if not spec.startswith(MEAN):
        return [spec]
    found: list[str] = []
    for piece in spec.removeprefix(MEAN).split("+"):
        whole = not found or found[-1] in gallery() or found[-1].endswith(SUFFIX)
        found = [*found, piece] if whole else [*found[:-1], f"{found[-1]}+{piece}"]
    return found


def assign(
    people: Sequence[int], donor: str, *, own: Sequence[Path] = (), seed: int, salt: str,
    known: Mapping[int, str] | None = None, taken: Collection[str] = (),
) -> dict[int, str]:  # fmt: skip
    """The spec of each person's donor, which depends on the arguments alone, never on what a person looks like.

    Parameters
    ----------
    people : numbers of the people of a video.
    donor : "auto", a donor for each: single ones, then averages of two, of three ..; "mean:K", an average of K for
        each, as k-Same-M does (`aam.averaging`), but the person's own face is in none of them; or a spec, for all.
    own : models that replace the gallery.
    seed, salt : choose the order; the salt is the video's name, so that not every video begins with the same donor.
    known : donors of some people, which go before the choice.
    taken : donors that nobody else should get.

    Donors are distinct as long as there are any; after that they are given again.

    Raises
    ------
    DonorError
        When K is more than there are, or there are none.
    """
    fixed = {person: spec for person, spec in (known or {}).items() if person in people}
    order = _endless(donor, _names(own), seed, salt, {*fixed.values(), *taken})
    return {person: fixed[person] if person in fixed else next(order) for person in people}


def _names(own: Sequence[Path]) -> tuple[str, ...]:
    wrong = [path for path in own if path.suffix != SUFFIX]
    if wrong:
        raise DonorError(f"a donor is a file NAME{SUFFIX}, got {wrong[0]}; make one with: guise enroll VIDEO")
    return tuple(dict.fromkeys(map(str, own))) or gallery()


def _endless(
    donor: str, names: Sequence[str], seed: int, salt: str, taken: Collection[str]
) -> Iterator[str]:  # fmt: skip
    """Specs in the order in which they are given; from the first again when there is no other."""
    sizes = _sizes(donor, len(names))
    if not sizes:
        yield from repeat(donor)
    yield from (spec for size in sizes for spec in _subsets(names, size, seed, salt) if spec not in taken)
    while True:
        yield from (spec for size in sizes for spec in _subsets(names, size, seed, salt))


def _sizes(donor: str, most: int) -> range:
    """How many donors are averaged, in the order of trying; empty when the donor is a spec."""
    if donor == "auto":
        return range(1, most + 1)
    text = donor.removeprefix(MEAN)
    if text == donor or not text.isdigit():
        return range(0)
    if not 1 <= int(text) <= most:
        raise DonorError(f"{donor} takes the average of {text} donors, there are {most}; choose 1 to {most}")
    return range(int(text), int(text) + 1)


def _subsets(names: Sequence[str], size: int, seed: int, salt: str) -> Iterator[str]:
    """Every subset of a size once, as a spec, in an order drawn by SHA-256."""
    seen: set[str] = set()
    for draw in count():
        if len(seen) == comb(len(names), size):
            return
        order = sorted(names, key=lambda name: _digest(seed, salt, size, draw, Path(name).name))
        spec = MEAN * (size > 1) + "+".join(sorted(order[:size]))
        if spec not in seen:
            seen.add(spec)
            yield spec


def _digest(*values: object) -> bytes:
    return hashlib.sha256(repr(values).encode()).digest()
