"""Verdicts by eye that nobody can colour: swaps and untouched clips under random names, judged before the key is read.

    python -m benchmarks.picture.blind make --work DIR     # sheets, empty verdicts, and the key apart from them
    python -m benchmarks.picture.blind score --work DIR    # refused until every verdict is written down

Two tests.  `fools`: is this an untouched video?  Six telling frames in their own pixels and eight successive ones, of
the swaps of `picture.identity`, of six with the faces that ship with Guise, and of untouched clips that are encoded as
often and as finely.  `donors`: which of four portraits is the face that a swap shows?  The donor, and three of
the same sex whom a recogniser finds nearest to the donor.
"""

from __future__ import annotations

import argparse
import csv
import json
import random
import secrets
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.children import CommandError
from benchmarks.common import F64, Clip, Criterion, Picture, Report, Table
from benchmarks.embeddings import Recogniser
from benchmarks.picture import identity, sheets
from benchmarks.picture.program import WORK, enrolled, stretch, swapped
from guise.app.measure.curves import expression
from guise.app.media import EncodeOptions, open_input
from guise.app.media.pictures import labelled, save_picture, sheet
from guise.app.swapping.donors import FIRST_NAMES, open_donor
from guise.common.arrays import F32

# (source, fictional donor): across sex, skin and age; chosen before the first verdict, and kept.
FICTIONAL = (
    ("talk_r2", "Walter"),
    ("studio_d5", "Amara"),
    ("webcam_a1", "Kenji"),
    ("phone_s29", "Asha"),
    ("address_o1", "Omar"),
    ("grid_lwbsza", "Elena"),
)
OTHER_TAKES = {  # of a person who has another clip
    "webcam_a2": "webcam_a1", "address_o2": "address_o1", "address_o3": "address_o1",
    "grid_id2_vcd_swwp2s": "grid_pwij3p",
}  # fmt: skip
WOMEN = {
    "grid_brbk7n", "grid_lwbsza", "phone_s29", "room_s18", "studio_d3", "studio_d6", "studio_d7", "talk_r4",
    "p02", "p03", "p06", "p14", "Amara", "Mei", "Elena", "Asha",
}  # fmt: skip
NO_PORTRAIT = ("street_crowd", "gesture_")  # clips of many or of very small faces
UNTOUCHED = 15
SUCCESSIVE = 8  # frames of a strip
LETTERS = "ABCD"  # of the portraits
FOOLS = ("yes", "almost", "no")
FAULTS = ("irises", "ghosts", "brows", "objects", "seam", "soft", "other")
NEVER = ("irises", "ghosts", "brows", "objects")  # faults for which no swap may be judged "no"
LEAST_FOOLED, LEAST_RECOGNISED = 14 / 30, 28 / 30
VERDICTS = "verdicts.csv"
COLUMNS = {"fools": ("name", "fools", "faults"), "donors": ("name", "letter")}
NOT_THERE = "{} is missing; --shared names the folder that holds data/ and models/."
Verdict = Mapping[str, str]
Key = Mapping[str, Mapping[str, str]]


class BlindError(ValueError):
    """Sheets, verdicts or a key that cannot be used, in one sentence."""


@dataclass(frozen=True, eq=False)
class Portrait:
    """A face at rest: picture (h, w, 3), landmarks (81, 2) in it, and the recogniser's embedding (128,)."""

    picture: Picture
    shape: F64
    embedding: F32


# -- making ---------------------------------------------------------------------------------------------------


def make(options: argparse.Namespace) -> None:
    """Swap what is not swapped yet, and write sheets, empty verdicts and the key."""
    require(options)
    if options.sheets.exists() and any(options.sheets.iterdir()):
        raise BlindError(f"{options.sheets} holds sheets already; delete it, or name another with --sheets.")
    if options.sheets.resolve() in options.key.resolve().parents:
        raise BlindError(
            f"{options.key} lies beside the sheets, where viewers would see it; name another --key."
        )
    pairs = (*identity.PAIRS[:1], *FICTIONAL[:1]) if options.quick else (*identity.PAIRS, *FICTIONAL)
    swaps = [swap_of(*pair, options) for pair in pairs]
    sources = sorted({source for source, _ in identity.PAIRS})
    chosen = random.SystemRandom().sample(sources, 2 if options.quick else UNTOUCHED)
    originals = [untouched(name, options) for name in chosen]
    key = {"fools": write_fools([*swaps, *originals], options.sheets / "fools")}
    key["donors"], key["letters"] = write_donors(swaps, options.sheets / "donors", options)
    options.key.parent.mkdir(parents=True, exist_ok=True)
    options.key.write_text(json.dumps(key, indent=1) + "\n")


def require(options: argparse.Namespace) -> None:
    """BlindError when data are missing."""
    for needed in (Path("data") / "real", Path("data") / "synthetic", Path("models") / "mobilefacenet.onnx"):
        if not (options.shared / needed).exists():
            raise BlindError(NOT_THERE.format(options.shared / needed))


def swap_of(source: str, donor: str, options: argparse.Namespace) -> Clip:
    """The swap SOURCE__DONOR of the working folder, made unless it is there, with the original's landmarks."""
    fictional, seconds = donor in FIRST_NAMES.values(), identity.ENROLMENT_SECONDS
    folder = options.work / options.look / ("fictional" if fictional else "")
    output = folder / f"{source}__{donor}.mp4"
    if not output.exists():
        own = enrolled(identity.cut(options, source, seconds, "people"))
        other = donor if fictional else enrolled(identity.cut(options, donor, seconds, "people"))
        video = identity.cut(options, source, identity.SOURCE_SECONDS, "sources")
        common.say(f"swapping {output.stem}")
        swapped(video, own, other, output, "--look", options.look)
    return Clip(output.stem, output, identity.clip_of(options.shared, source).points)


def untouched(name: str, options: argparse.Namespace) -> Clip:
    """The last seconds of a clip, which show other frames than its swap, encoded once more as the swap is."""
    clip, seconds = identity.clip_of(options.shared, name), identity.SOURCE_SECONDS
    with open_input(clip.video) as media:
        start = max(0, len(clip.points) - round(seconds * media.frame_rate))
    folder = options.work / "untouched"
    cut = stretch(clip.video, folder / f"{name}_lossless.mp4", seconds, start=start)
    video = stretch(cut, folder / f"{name}.mp4", seconds, options=EncodeOptions())
    return Clip(name, video, clip.points[start:])


def named(items: Iterable[Clip]) -> dict[str, Clip]:
    """The clips under random names, in the order of these, so that no list and no time of a file tells more."""
    found: dict[str, Clip] = {}
    for item in items:
        while (name := secrets.token_hex(3)) in found:
            pass
        found[name] = item
    return dict(sorted(found.items()))


def write_fools(clips: Sequence[Clip], folder: Path) -> dict[str, str]:
    """The sheets of swaps and untouched clips.  Returns what each name stands for."""
    shown = named(clips)
    for name, clip in shown.items():
        common.say(f"drawing {name}")
        seen = within(clip)
        frames = telling(seen.points)
        save_picture(folder_of(folder) / f"{name}_frames.png", rows(seen, frames, 3))
        strip = range(first := liveliest(seen.points), first + SUCCESSIVE)
        save_picture(folder / f"{name}_strip.png", rows(seen, strip, 4))
    write_empty(folder, "fools", shown)
    return {name: clip.name for name, clip in shown.items()}


def write_donors(
    swaps: Sequence[Clip], folder: Path, options: argparse.Namespace
) -> tuple[dict[str, str], dict[str, str]]:
    """The sheets of faces above four portraits.  Returns the swap that each name stands for, and the donor's letter."""
    shown, letters = named(swaps), {}
    recognise = Recogniser(options.shared / "models" / "mobilefacenet.onnx")
    for name, clip in shown.items():
        common.say(f"drawing {name}")
        source, donor = clip.name.split("__")
        known = {
            who: portrait_of(who, options.shared, recognise) for who in (donor, *kin(donor, options.shared))
        }
        four = [donor, *nearest(donor, source, {who: p.embedding for who, p in known.items()})]
        random.SystemRandom().shuffle(four)
        save_picture(
            folder_of(folder) / f"{name}.png", with_portraits(within(clip), [known[w] for w in four])
        )
        letters[name] = LETTERS[four.index(donor)]
    write_empty(folder, "donors", shown)
    return {name: clip.name for name, clip in shown.items()}, letters


def folder_of(folder: Path) -> Path:
    """The folder, made unless it is there."""
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def write_empty(folder: Path, test: str, names: Iterable[str]) -> None:
    """A file of verdicts to fill in."""
    with (folder_of(folder) / VERDICTS).open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS[test])
        rows.writerows([name, *[""] * (len(COLUMNS[test]) - 1)] for name in names)


# -- sheets ---------------------------------------------------------------------------------------------------


def within(clip: Clip) -> Clip:
    """The clip with the landmarks of those frames only that the video has."""
    return Clip(clip.name, clip.video, clip.points[: sum(1 for _ in common.frames(clip))])


def telling(points: F64) -> list[int]:
    """Six frames that tell most, chosen by landmarks (n, 81, 2) alone, so that they say nothing about a swap."""
    curves = {"broadest mouth": expression(points)["mouth width"]}
    return list(sheets.chosen({**sheets.scores(points), **curves}).values())


def liveliest(points: F64) -> int:
    """The first of the successive frames in which the face (n, 81, 2) moves most."""
    curves = np.stack(list(expression(points).values()))
    change = np.abs(np.diff(curves, axis=1)).sum(0)
    total = np.convolve(change, np.ones(SUCCESSIVE - 1), mode="valid")
    if not np.isfinite(total).any():
        raise BlindError(f"no {SUCCESSIVE} successive frames show a face, of {len(points)}.")
    return int(np.nanargmax(total))


def rows(clip: Clip, indices: Collection[int], columns: int) -> Picture:
    """Frames of a clip in rows, in the order of the clip."""
    cuts = list(sheets.cut_outs(clip, indices, sheets.side_of(clip.points[list(indices)])).values())
    return sheet([cuts[k : k + columns] for k in range(0, len(cuts), columns)])


def with_portraits(clip: Clip, four: Sequence[Portrait]) -> Picture:
    """Four frames of a clip above the portraits, all of one size, with a letter under each portrait."""
    indices = telling(clip.points)[:4]
    side = sheets.side_of(clip.points[indices])
    faces = list(sheets.cut_outs(clip, indices, side).values())
    below = [labelled(resized(framed(p), side), letter) for p, letter in zip(four, LETTERS, strict=True)]
    return sheet([faces, below])


def framed(portrait: Portrait) -> Picture:
    """A portrait with as much around the face as the frames have."""
    shape = portrait.shape
    return sheets.square(portrait.picture, (shape.min(0) + shape.max(0)) / 2, sheets.side_of(shape[None]))


def resized(picture: Picture, side: int) -> Picture:
    """A square picture (side, side, 3)."""
    how = cv2.INTER_AREA if side < len(picture) else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, (side, side), interpolation=how), np.uint8)


# -- portraits ------------------------------------------------------------------------------------------------


def kin(donor: str, shared: Path) -> list[str]:
    """The people whose portraits are of the donor's kind: real, rendered for tests, or shipped with Guise."""
    rendered, shipped = common.synthetic_people(shared), list(FIRST_NAMES.values())
    if donor in shipped or donor in rendered:
        return shipped if donor in shipped else rendered
    names = {
        p.name.removesuffix(".landmarks.npz") for p in (shared / "data" / "real").glob("*.landmarks.npz")
    }
    return sorted(name for name in names - OTHER_TAKES.keys() if not name.startswith(NO_PORTRAIT))


@cache
def portrait_of(who: str, shared: Path, recognise: Recogniser) -> Portrait:
    """A person at rest, from their clip or from a model that ships with Guise."""
    if who in FIRST_NAMES.values():
        still = open_donor(who).rest_frame
        picture, shape = still.picture, np.asarray(still.shape, np.float64)
    else:
        clip = identity.clip_of(shared, who)
        index = sheets.chosen({"neutral": sheets.scores(clip.points)["neutral"]})["neutral"]
        picture, shape = next(f.rgb() for f in common.frames(clip) if f.index == index), clip.points[index]
    return Portrait(picture, shape, recognise(picture, shape))


def nearest(donor: str, source: str, embeddings: Mapping[str, F32]) -> list[str]:
    """Three people of the donor's sex, the nearest ones: neither the donor nor the person in the video."""
    out = {OTHER_TAKES.get(name, name) for name in (donor, source)}
    others = [name for name in embeddings if OTHER_TAKES.get(name, name) not in out]

    def distance(name: str) -> tuple[bool, float]:
        return (name in WOMEN) != (donor in WOMEN), -float(embeddings[donor] @ embeddings[name])

    return sorted(others, key=distance)[: len(LETTERS) - 1]


# -- scoring --------------------------------------------------------------------------------------------------


def score(options: argparse.Namespace) -> Report:
    """The figures of both tests.  BlindError unless every verdict is there; the key is read after that only."""
    fools, donors = (verdicts(options.sheets / test, test) for test in COLUMNS)
    key = read_key(options.key)
    if any(key[test].keys() != given.keys() for test, given in (("fools", fools), ("donors", donors))):
        raise BlindError(f"{options.key} belongs to other sheets than those of {options.sheets}.")
    return summary(fools, donors, key)


def read_key(path: Path) -> Key:
    """What the names stand for."""
    try:
        key = json.loads(path.read_text())
        return {part: dict(key[part]) for part in ("fools", "donors", "letters")}
    except (OSError, ValueError, TypeError, KeyError):
        raise BlindError(f"{path} is no key that `make` wrote.") from None


def verdicts(folder: Path, test: str) -> dict[str, Verdict]:
    """The verdicts of a test by name.  BlindError for the first sheet without a valid one."""
    try:
        with (folder / VERDICTS).open(newline="") as file:
            given = {row["name"]: row for row in csv.DictReader(file)}
    except (OSError, KeyError):
        raise BlindError(f"{folder / VERDICTS} is no file of verdicts that `make` wrote.") from None
    names = sorted({path.stem.split("_")[0] for path in folder.glob("*.png")})
    for name in names:
        if reason := wrong(test, given.get(name, {})):
            raise BlindError(
                f"{folder / VERDICTS}, {name}: {reason}; the key stays closed until all are judged."
            )
    return {name: given[name] for name in names}


def wrong(test: str, row: Verdict) -> str | None:
    """What is wrong with a verdict.

    >>> wrong("fools", {"fools": "yes", "faults": ""}), wrong("donors", {"letter": "E"})
    (None, "letter must be one of A B C D, got 'E'")
    """
    column, words = ("fools", FOOLS) if test == "fools" else ("letter", tuple(LETTERS))
    if (verdict := row.get(column) or "") not in words:
        return f"{column} must be one of {' '.join(words)}, got {verdict!r}"
    if test == "donors":
        return None
    faults = faults_of(row)
    if unknown := [word for word in faults if word not in FAULTS]:
        return f"faults must be of {' '.join(FAULTS)}, got {unknown[0]!r}"
    return None if faults or verdict == "yes" else f"{verdict!r} needs a fault of {' '.join(FAULTS)}"


def faults_of(row: Verdict) -> list[str]:
    """The fault words of a verdict, which spaces divide."""
    return (row.get("faults") or "").split()


def summary(fools: Mapping[str, Verdict], donors: Mapping[str, Verdict], key: Key) -> Report:
    """How many swaps fool, how many untouched clips are taken for swaps, which faults, and who is recognised."""
    swaps = {key["fools"][n]: v for n, v in fools.items() if "__" in key["fools"][n]}
    originals = {key["fools"][n]: v for n, v in fools.items() if "__" not in key["fools"][n]}
    refused = [word for row in swaps.values() if row["fools"] == "no" for word in faults_of(row)]
    recognised = {key["donors"][n]: key["letters"][n] == v["letter"] for n, v in donors.items()}
    counts = {kind: Counter(row["fools"] for row in of.values()) for kind, of in both(swaps, originals)}
    faults = {
        kind: Counter(w for row in of.values() for w in faults_of(row)) for kind, of in both(swaps, originals)
    }
    fooled, doubted = share(counts["swaps"], "yes"), share(counts["untouched"], "almost", "no")
    return Report(
        "picture.blind", "Picture: verdicts by eye, blind",
        [
            Criterion("swaps that fool", fooled, ">=", LEAST_FOOLED, "share"),
            Criterion("swaps judged no for irises, ghosts, brows or objects",
                      float(sum(word in NEVER for word in refused)), "<=", 0.0),
            Criterion("donors recognised among four", float(np.mean(list(recognised.values()))), ">=",
                      LEAST_RECOGNISED, "share"),
        ],
        [
            Table("Taken for untouched", ("", *FOOLS), [(k, *(c[w] for w in FOOLS)) for k, c in counts.items()]),
            Table("Faults named", ("", *FAULTS), [(k, *(c[w] for w in FAULTS)) for k, c in faults.items()]),
            Table("Swaps", ("pair", "fools", "faults", "donor recognised"), [
                (pair, row["fools"], " ".join(faults_of(row)), "yes" if recognised.get(pair) else "no")
                for pair, row in sorted(swaps.items())
            ]),
            Table("Untouched", ("clip", "fools", "faults"), [
                (name, row["fools"], " ".join(faults_of(row))) for name, row in sorted(originals.items())
            ]),
        ],
        [f"Untouched clips not taken for untouched: {doubted:.2f}, by which to read the share of swaps that fool; "
         "a quarter of the donors is recognised by chance."],
    )  # fmt: skip


def both(
    swaps: Mapping[str, Verdict], originals: Mapping[str, Verdict]
) -> list[tuple[str, Mapping[str, Verdict]]]:
    """The two kinds of clips with their names."""
    return [("swaps", swaps), ("untouched", originals)]


def share(counts: Counter[str], *words: str) -> float:
    """Which share of the verdicts are these words; NaN without verdicts.

    >>> share(Counter(["yes", "no"]), "yes")
    0.5
    """
    return sum(counts[word] for word in words) / counts.total() if counts.total() else float("nan")


# -- the command ----------------------------------------------------------------------------------------------


def parser() -> argparse.ArgumentParser:
    """Two commands with the options of both."""
    made = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    commands = made.add_subparsers(dest="command", required=True)
    for name, what in (("make", "draw the sheets"), ("score", "read the verdicts, then the key")):
        add = commands.add_parser(name, help=what, description=what).add_argument
        add(
            "--work",
            type=Path,
            default=WORK,
            help="models and swaps, as of picture.identity; those there are used",
        )
        add("--sheets", type=Path, help="folder of the sheets and verdicts (default: blind in --work)")
        add("--key", type=Path, help="what the names stand for (default: blind_key.json in --work)")
        if name == "make":
            add("--shared", type=Path, default=common.SHARED, help="folder that holds data/ and models/")
            add("--look", choices=("swap", "paper"), default="swap", help="how the face is drawn")
            add("--quick", action="store_true", help="few clips, to check the script")
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; what is wrong is said in one sentence."""
    made = parser()
    options = made.parse_args(arguments)
    options.sheets = options.sheets or options.work / "blind"
    options.key = options.key or options.work / "blind_key.json"
    try:
        if options.command == "make":
            make(options)
        else:
            print(score(options).markdown())
    except (BlindError, CommandError) as error:
        made.error(str(error))


if __name__ == "__main__":
    main()
