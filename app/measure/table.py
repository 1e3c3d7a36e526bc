"""The figures as a table for people: a column for each output."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

from guise.app.measure.attack import AttackedOutput, AttackResult, RankOne, ViewFigures, Worst
from guise.app.measure.attackers import By
from guise.app.measure.curves import ANGLES, CURVES
from guise.app.measure.figures import MeasureResult, OutputFigures, Privacy
from guise.app.measure.privacy import Scores

FIRST_HEADING = "what"
NO_VALUE = "-"
MAX_RANKS_SHOWN = 4
RANK_HEADINGS = ("rank 1 by frame, clip", "unchanged", "naive", "reverse", "parrot")
SIMILARITY_HEADINGS = ("similarity: mean, 99 %", "own", "others", "own tilted", "others tilted")

_Cell = Callable[[OutputFigures], str]
_PrivateCell = Callable[[Privacy], str]


def rows_of(result: MeasureResult) -> list[list[str]]:
    """Rows of cells: what, then a cell for each output."""
    cells = [*(_private(result) if result.recogniser else ()), *_useful(), *_files()]
    return [[name, *(cell(one) for one in result.outputs)] for name, cell in cells]


def _private(result: MeasureResult) -> Iterator[tuple[str, _Cell]]:
    for name, cell in _PRIVATE:
        yield name, _of_privacy(cell)
    rate, limit = result.gallery["false_accept_rate"], result.gallery["threshold"]
    if rate is not None:
        yield (
            f"verified at false accepts of {rate:.1%} (similarity > {limit:.2f})",
            _of_privacy(lambda p: f"{share(p.verification)} (unswapped {share(p.unswapped_verification)})"),
        )
        yield "equal error rate (50 %: tells nothing)", _of_privacy(lambda p: share(p.equal_error_rate))
    for state in dict.fromkeys(s for one in result.outputs if one.privacy for s in one.privacy.by_state):
        yield f"similarity to source, {state}", _of_privacy(_in_state(state))


def _in_state(state: str) -> _PrivateCell:
    return lambda p: _scores(p.by_state.get(state))


def _of_privacy(cell: _PrivateCell) -> _Cell:
    return lambda one: NO_VALUE if one.privacy is None else cell(one.privacy)


def _places(privacy: Privacy) -> str:
    """The rank of each person; of many people the lowest ones."""
    places = sorted(one.rank for one in privacy.people)
    shown = ", ".join(map(str, places[:MAX_RANKS_SHOWN])) + (" .." if len(places) > MAX_RANKS_SHOWN else "")
    return f"{shown} of {privacy.people[0].of}"


_PRIVATE: tuple[tuple[str, _PrivateCell], ...] = (
    ("similarity to source: mean, 99th percentile", lambda p: _scores(p.to_source)),
    ("the same, unswapped", lambda p: _scores(p.unswapped)),
    ("similarity to donor (unswapped)", lambda p: f"{_mean(p.to_donor)} ({_mean(p.unswapped_to_donor)})"),
    ("re-identified, rank 1 (unswapped; chance)", lambda p: f"{share(p.rank_one)} ({share(p.unswapped_rank_one)}; "
     f"{share(p.chance)})"),
    ("rank of each person over all frames", _places),
)  # fmt: skip


def _useful() -> Iterator[tuple[str, _Cell]]:
    yield "faces found in both", lambda one: share(one.utility.found)
    yield "expression kept, mean correlation", lambda one: number(one.utility.expression)
    for name in CURVES:
        yield f"  {name}", _curve(name)
    yield "landmark error, motion only (% of eye distance)", _landmarks
    for name in ANGLES:
        yield f"{name} error, motion only (degrees)", _angle(name)
    yield "jitter, times the original's", lambda one: number(one.utility.jitter_ratio)


def _curve(name: str) -> _Cell:
    return lambda one: number(one.utility.correlation[name])


def _angle(name: str) -> _Cell:
    return lambda one: (
        f"{number(one.utility.pose_error[name])}, {number(one.utility.pose_motion_error[name])}"
    )


def _landmarks(one: OutputFigures) -> str:
    return f"{number(one.utility.landmark_error)}, {number(one.utility.motion_error)}"


def _files() -> Iterator[tuple[str, _Cell]]:
    yield "time stamps", _times
    yield "sound", lambda one: ", ".join(s.state for s in one.files.sound) or "none"
    yield "picture outside the faces (PSNR, dB)", lambda one: _psnr(one.files.untouched_psnr)


def number(value: float) -> str:
    """Two decimals.

    >>> number(0.123), number(float("nan"))
    ('0.12', '-')
    """
    return f"{value:.2f}" if math.isfinite(value) else NO_VALUE


def share(value: float) -> str:
    """A share as percent.

    >>> share(0.1234)
    '12.3 %'
    """
    return f"{100 * value:.1f} %" if math.isfinite(value) else NO_VALUE


def _scores(scores: Scores | None) -> str:
    return NO_VALUE if scores is None else f"{scores.mean:.2f}, {scores.p99:.2f}"


def _mean(scores: Scores | None) -> str:
    return NO_VALUE if scores is None else f"{scores.mean:.2f}"


def _times(one: OutputFigures) -> str:
    return "identical" if one.files.times_identical else f"within {1000 * one.files.time_error:.1f} ms"


def _psnr(value: float) -> str:
    return "identical" if math.isinf(value) and value > 0 else number(value)


def rank_rows(output: AttackedOutput) -> list[list[str]]:
    """For each view how often each attacker is right, by single frames and by clips."""
    return [
        [one.view, *(f"{number(by['frame'].share)}, {number(by['clip'].share)}" for by in _attackers(one))]
        for one in output.views
    ]


def similarity_rows(output: AttackedOutput) -> list[list[str]]:
    """For each view the similarities of the output's faces to their own people and to others."""
    return [
        [one.view, *map(_scores, (one.own, one.impostors, one.tilted, one.tilted_impostors))]
        for one in output.views
    ]


def _attackers(view: ViewFigures) -> list[Mapping[By, RankOne]]:
    return [view.unchanged, *view.attackers.values()]


def worst_sentence(result: AttackResult, output: AttackedOutput) -> str:
    """The worst attackers in words."""
    return (
        f"{output.name}: of {result.people} people (chance {share(result.chance)}) the worst attacker recognises "
        f"{_worst(output.worst)}; by hair and outline alone {_worst(output.worst_outline)}"
    )


def _worst(worst: Worst) -> str:
    return (
        f"{_with_interval(worst.rank_one)} ({worst.attacker}, by {worst.by}, {worst.view}; "
        f"by luck {share(worst.luck)}, up to {share(worst.luck_95)})"
    )


def _with_interval(rank: RankOne) -> str:
    low, high = rank.interval
    return f"{share(rank.share)} [{share(low)}, {share(high)}]"
