"""Each look draws as it did, by both renderers: tests/golden has pictures of a sample clip and faces of the gallery.

After a wanted change: GUISE_UPDATE_GOLDEN=1 pytest tests/test_drawing_golden.py, then look at tests/golden, and say
what has changed and by how much.
"""

import os
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks import open_landmarker
from guise.aam.model import Identity
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import LOOKS, Look
from guise.app.media import Frame, open_input
from guise.app.swapping.donors import open_donor
from guise.app.swapping.puppet import Puppet
from guise.common.kernels import COMPILED, RUNNING
from guise.common.threads import one_thread

GOLDEN = Path(__file__).parent / "golden"
PERSON = GOLDEN / "p01.guise"  # a small model of the first sample person, so that no enrolment counts
SHOWN = (0, 7, 16)  # of the frames that are drawn: the first one, one soon after, one with all in motion
FRAMES = 17
CROP = np.s_[70:330, 210:430]
# Processors round differently, and a network's answer by a hundredth of its range.
MOST_MEAN, MOST, MOST_SHARE = 0.6, 12, 0.002


def drawn(kind: str, renderer: str) -> np.ndarray:
    """Three frames (h, 3 w, 3) RGB in a look."""
    look = replace(LOOKS[kind], renderer=renderer)
    person, donor = Identity.load(PERSON), open_donor("p06" if kind == "disguise" else "p04")
    pictures = []
    with (
        one_thread(),
        engine_of(person, donor, look) as engine,
        open_input(SAMPLES / "p01" / "talk2.mp4") as media,
    ):
        for frame in islice(media, FRAMES):
            assert engine.swap(frame).outcome == "swapped"
            if frame.index in SHOWN:
                pictures.append(shown(frame))
    return np.hstack(pictures)


def engine_of(person: Identity, donor: Identity, look: Look) -> Engine | Puppet:
    finder = open_landmarker("builtin")
    if look.kind == "puppet":
        return Puppet(person, donor, finder, look)
    return Engine(person, Donor.of(donor), finder, look)


def shown(frame: Frame) -> np.ndarray:
    return cv2.resize(frame.rgb()[CROP], None, fx=0.75, fy=0.75, interpolation=cv2.INTER_AREA)


def differs(picture: np.ndarray, other: np.ndarray) -> str:
    """What is too different, or nothing."""
    away = np.abs(picture.astype(int) - other).max(2)
    found = float(away.mean()), float((away > MOST).mean())
    fine = found[0] <= MOST_MEAN and found[1] <= MOST_SHARE
    return "" if fine else f"mean difference {found[0]:.2f}, {100 * found[1]:.2f} % by more than {MOST}"


def golden(kind: str) -> np.ndarray:
    image = cv2.imread(str(GOLDEN / f"look_{kind}.png"), cv2.IMREAD_COLOR_RGB)
    assert image is not None, "no golden picture: run with GUISE_UPDATE_GOLDEN=1 and look at it"
    return image


@pytest.mark.parametrize("kind", sorted(LOOKS))
def test_a_look_draws_its_golden_frames(kind: str) -> None:
    picture = drawn(kind, "cpu")
    if os.environ.get("GUISE_UPDATE_GOLDEN") == "1":
        cv2.imwrite(str(GOLDEN / f"look_{kind}.png"), picture[..., ::-1])
    assert not differs(picture, golden(kind))


@pytest.mark.egl
@pytest.mark.parametrize("kind", sorted(LOOKS))
def test_gl_draws_the_golden_frames_too(kind: str) -> None:
    assert not differs(drawn(kind, "gl"), golden(kind))


@pytest.mark.slow
@pytest.mark.skipif(COMPILED is None, reason="no kernels are built here")
@pytest.mark.parametrize("kind", ["swap", "disguise"])
def test_every_instruction_set_draws_the_same_bytes(kind: str) -> None:
    pictures = []
    for name in COMPILED.sets():
        COMPILED.use(name)
        pictures.append(drawn(kind, "cpu"))
    COMPILED.use(RUNNING)
    for picture in pictures[1:]:
        np.testing.assert_array_equal(picture, pictures[0])


@pytest.mark.slow
@pytest.mark.skipif(COMPILED is None, reason="the twins are what runs here")
def test_the_twins_draw_the_golden_frames_too() -> None:
    only = ("-q", "-n0", "-p", "no:cacheprovider", "-k", test_a_look_draws_its_golden_frames.__name__)
    environment = os.environ | {"GUISE_KERNELS": "numpy"}
    environment.pop("PYTEST_XDIST_WORKER", None)  # it is a run of its own, with folders of its own
    done = subprocess.run(
        [sys.executable, "-m", "pytest", __file__, *only], env=environment,
        cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert f"{len(LOOKS)} passed" in done.stdout


@pytest.mark.parametrize("change", ["brighter", "moved", "blurred"])
def test_a_changed_picture_is_told_from_the_golden_one(change: str) -> None:
    picture = golden("swap")
    changed = {
        "brighter": np.minimum(picture.astype(int) + 2, 255).astype(np.uint8),
        "moved": np.roll(picture, 1, axis=1),
        "blurred": cv2.GaussianBlur(picture, (0, 0), 0.8),
    }[change]
    assert differs(changed, picture)
