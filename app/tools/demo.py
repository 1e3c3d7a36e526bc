"""The demonstration: two sample people are enrolled, and one's face is swapped onto the other.

Writes the models, the swapped video, a video of it beside the original, and a contact sheet.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from guise.aam.model import Identity
from guise.app.enrolment.file import EnrolReport, enrol_file
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.media import Frame, MediaError, open_input, open_sink, process
from guise.app.media.pictures import Picture, labelled, save_picture, sheet, shrunk
from guise.app.media.synthetic import synthetic_tags
from guise.app.swapping.file import swap_file
from guise.app.swapping.report import DEFAULTS, SwapReport, SwapSettings
from guise.common.files import require_free
from guise.common.samples import samples_folder

HEAD, FACE = "p01", "p06"  # whose video, whose face
SHEET_COLUMNS = 6
SHEET_PICTURE_WIDTH = 320  # pixels


@dataclass(frozen=True)
class DemoReport:
    """What the demonstration made."""

    enrolments: tuple[EnrolReport, ...]
    swap: SwapReport
    video: str
    side_by_side: str
    contact_sheet: str

    def as_json(self) -> dict[str, Any]:
        """The report as JSON holds it."""
        return asdict(self) | {"swap": self.swap.as_json()}


def find_samples(folder: Path | None) -> Path:
    """The folder of sample people: the given one, or the one that lies beside this package in a checkout.

    Raises MediaError when the clips are not there.
    """
    samples = folder or samples_folder()
    wanted = [samples / person / clip for person in (HEAD, FACE) for clip in ("talk.mp4", "talk.npz")]
    wanted.append(samples / HEAD / "talk2.mp4")
    missing = next((file for file in wanted if not file.is_file()), None)
    if missing is not None:
        raise MediaError(
            f"the sample clips are not in {samples} ({missing.relative_to(samples)} is missing): "
            "give the folder sample_videos of a Guise checkout with --samples"
        )
    return samples


def run_demo(samples: Path | None, folder: Path, settings: SwapSettings = DEFAULTS) -> DemoReport:
    """Enrol, swap and compare; the files are written to `folder`, which is created if its parent exists."""
    samples = find_samples(samples)
    names = ["swapped.mp4", "side_by_side.mp4", "contact_sheet.png", f"{HEAD}.guise", f"{FACE}.guise"]
    _make_folder(folder)
    video, beside, contact, head, face = (folder / name for name in names)
    for output in (video, beside, contact, head, face):
        require_free(output, force=settings.force)
    enrolments = tuple(_enrol(samples, model, settings) for model in (head, face))
    clip = samples / HEAD / "talk2.mp4"
    report = swap_file(clip, Identity.load(face), video, source=Identity.load(head), settings=settings)
    side_by_side(clip, video, beside, settings)
    contact_sheet(clip, video, contact)
    return DemoReport(enrolments, report, str(video), str(beside), str(contact))


def side_by_side(original: Path, swapped: Path, output: Path, settings: SwapSettings = DEFAULTS) -> None:
    """Write a video with the original on the left, the swapped one on the right, and the original's sound."""
    with open_input(original) as left, open_input(swapped) as right:
        others = iter(right)

        def join(frame: Frame) -> None:
            pictures = labelled(frame.rgb(), "original"), labelled(next(others).rgb(), "swapped")
            frame.show(np.concatenate(pictures, axis=1))

        size = 2 * left.width, labelled(np.zeros((left.height, left.width, 3), np.uint8), "").shape[0]
        encode = replace(settings.encode, lossless=False)
        with open_sink(output, left, encode, force=settings.force, tags=synthetic_tags(), size=size) as sink:
            total = left.frame_count or 1
            process(left, sink, join, progress=lambda done: settings.progress("side by side", done / total))


def contact_sheet(original: Path, swapped: Path, output: Path, columns: int = SHEET_COLUMNS) -> None:
    """Write a picture with some frames of the original above the same frames of the swapped video."""
    pairs = list(_some_pairs(original, swapped, columns))
    above = [labelled(_small(before), f"original, frame {index}") for index, before, _ in pairs]
    below = [labelled(_small(after), f"swapped, frame {index}") for index, _, after in pairs]
    save_picture(output, sheet([above, below]))


def _some_pairs(original: Path, swapped: Path, count: int) -> Iterator[tuple[int, Picture, Picture]]:
    """Frame number, original and swapped picture, evenly spaced in the video."""
    with open_input(original) as left, open_input(swapped) as right:
        wanted = set(
            np.linspace(0, (left.frame_count or 1) - 1, count + 2).round().astype(int)[1:-1].tolist()
        )
        for before, after in zip(left, right, strict=False):
            if before.index in wanted:
                yield before.index, before.rgb(), after.rgb()


def _small(picture: Picture) -> Picture:
    return shrunk(picture, SHEET_PICTURE_WIDTH / picture.shape[1])


def _enrol(samples: Path, model: Path, settings: SwapSettings) -> EnrolReport:
    settings.say(f"enrolling {model.stem}")
    return enrol_file(
        [samples / model.stem / "talk.mp4"], model, LandmarkSource(), name=model.stem, force=settings.force,
        progress=settings.progress, say=settings.say,
    )  # fmt: skip


def _make_folder(folder: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise MediaError(f"{folder} is a file: give a folder with -o")
    folder.mkdir(exist_ok=True)
