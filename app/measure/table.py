"""The figures as a table for people: a column for each output."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

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


def rows_of(result: MeasureResult) -> list[list[str]]:
    """Rows of cells: what, then a cell for each output."""
    columns = [dict(_cells(result, one)) for one in result.outputs]
    return [[name, *(column.get(name, NO_VALUE) for column in columns)] for name in columns[0]]


def _cells(result: MeasureResult, one: OutputFigures) -> Iterator[tuple[str, str]]:
    """What is shown of an output, by name; the same names for all."""
    if one.privacy is not None:
        yield from _private(result, one.privacy)
    kept, files = one.utility, one.files
    yield "faces found in both", share(kept.found)
    yield "expression kept, mean correlation", number(kept.expression)
    for name in CURVES:
        yield f"  {name}", number(kept.correlation[name])
    yield "landmark error, motion only (% of eye distance)", _pair(kept.landmark_error, kept.motion_error)
    for name in ANGLES:
        yield (
            f"{name} error, motion only (degrees)",
            _pair(kept.pose_error[name], kept.pose_motion_error[name]),
        )
    yield "jitter, times the original's", number(kept.jitter_ratio)
    yield "time stamps", "identical" if files.times_identical else f"within {1000 * files.time_error:.1f} ms"
    yield "sound", ", ".join(s.state for s in files.sound) or "none"
    same = files.untouched_psnr == math.inf
    yield "picture outside the faces (PSNR, dB)", "identical" if same else number(files.untouched_psnr)


def _private(result: MeasureResult, p: Privacy) -> Iterator[tuple[str, str]]:
    yield "similarity to source: mean, 99th percentile", _scores(p.to_source)
    yield "the same, unswapped", _scores(p.unswapped)
    yield "similarity to donor (unswapped)", f"{_mean(p.to_donor)} ({_mean(p.unswapped_to_donor)})"
    yield (
        "re-identified, rank 1 (unswapped; chance)",
        f"{share(p.rank_one)} ({share(p.unswapped_rank_one)}; {share(p.chance)})",
    )
    yield "rank of each person over all frames", _places(p)
    rate, limit = result.gallery["false_accept_rate"], result.gallery["threshold"]
    if rate is not None:
        yield (
            f"verified at false accepts of {rate:.1%} (similarity > {limit:.2f})",
            f"{share(p.verification)} (unswapped {share(p.unswapped_verification)})",
        )
        yield "equal error rate (50 %: tells nothing)", share(p.equal_error_rate)
    for state in dict.fromkeys(s for one in result.outputs if one.privacy for s in one.privacy.by_state):
        yield f"similarity to source, {state}", _scores(p.by_state.get(state))


def _places(privacy: Privacy) -> str:
    """The rank of each person; of many people the lowest ones."""
    places = sorted(one.rank for one in privacy.people)
    shown = ", ".join(map(str, places[:MAX_RANKS_SHOWN])) + (" .." if len(places) > MAX_RANKS_SHOWN else "")
    return f"{shown} of {privacy.people[0].of}"


def _pair(whole: float, motion: float) -> str:
    return f"{number(whole)}, {number(motion)}"


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
