"""What attackers who learn still find in what is published, as users are told before they choose.

Figures of `python -m benchmarks.deidentify.attack --donors auto --region REGION`, which compares them with what it
measures.
"""

from __future__ import annotations

from dataclasses import dataclass

PEOPLE = 21


@dataclass(frozen=True)
class Reach:
    """Share of people found by the best attacker of the face, and of hair and outline with the face grey."""

    face: float
    outline: float


REACHES = {"face": Reach(0.29, 1.0), "head": Reach(0.24, 0.76)}  # by what a swap replaces
PROPOSAL = "Hair and outline stay: where they tell who somebody is, replace the head (--region head)."


def reach_of(region: str) -> str:
    """What is found behind a swap, in words.

    >>> reach_of("face")
    'the best attacker finds 29 % of 21 people by the face, and 100 % by hair and outline'
    """
    face, outline = (f"{100 * share:.0f} %" for share in vars(REACHES[region]).values())
    return f"the best attacker finds {face} of {PEOPLE} people by the face, and {outline} by hair and outline"


def reach_of_both() -> str:
    """What is found behind either, in words.

    >>> reach_of_both()[:60]
    'With the face or the head replaced, the best attacker finds '
    """
    faces, outlines = (
        " or ".join(f"{100 * getattr(one, name):.0f} %" for one in REACHES.values())
        for name in ("face", "outline")
    )
    return (
        f"With the face or the head replaced, the best attacker finds {faces} of {PEOPLE} people by the face, and "
        f"{outlines} by hair and outline."
    )
