"""Glasses, their rims and a fringe stay in front of the drawn face."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from models import model_file
from watched_cover import (
    BLACK,
    Scene,
    Watch,
    fake_parsing,
)
from worn_rims import lenses, with_rims

from guise.aam import rims
from guise.aam.landmarks.schemes import (
    LEFT_EYE,
    RIGHT_EYE,
    Group,
)
from guise.aam.model import Identity
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import DISGUISE, SWAP, Look
from guise.app.drawing.passes import cover
from guise.app.drawing.passes.cover import LIMITS
from guise.app.media import Frame


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


@pytest.fixture
def scene(p01: Identity) -> Scene:
    return Scene(p01)


@pytest.mark.parametrize(("sides", "worn"), [((RIGHT_EYE,), False), ((RIGHT_EYE, LEFT_EYE), True)])
def test_glasses_are_worn_before_both_eyes(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, sides: tuple[Group, ...], worn: bool
) -> None:
    plain = cover.parse_frame(FaceParser(), Frame.from_rgb(scene.rgb), scene.shape)
    shares = np.zeros_like(plain.shares)
    for eye in sides:
        lens = cv2.convexHull(scene.shape[eye].astype(np.float32))[:, 0]
        lens = (2 * lens - lens.mean(0)) @ plain.to_cells[:, :2].T + plain.to_cells[:, 2]
        cv2.fillConvexPoly(shares[FaceClass.GLASSES], np.round(lens).astype(np.int32), 1.0)
    parsing = FaceParsing(shares, plain.to_picture, plain.irises)
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    left = scene.show(scene.rgb)
    assert (left is not None and left.min() < 0.1) == worn


@pytest.mark.parametrize(
    ("look", "kept"), [(SWAP, True), (DISGUISE, False), (replace(DISGUISE, glasses="own"), True)]
)
def test_rims_stay_in_front_of_the_drawn_face(
    scene: Scene, look: Look, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rims, "wears_glasses", lambda *_: True)
    source, target = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    rgb, shape = with_rims(scene.rgb, scene.shape, (40, 35, 30)), scene.shape
    frame = Frame.from_rgb(rgb)
    with Engine(source, Donor.of(target), None, replace(look, renderer="cpu")) as engine:
        engine.draw(frame, shape)
    lower = lenses(shape)[:, 15:45].reshape(-1, 2).round().astype(int)
    before, after = (picture[lower[:, 1], lower[:, 0]].mean() for picture in (rgb, frame.rgb()))
    bare = scene.rgb[lower[:, 1], lower[:, 0]].mean()
    assert (abs(after - before) < 0.25 * (bare - before)) == kept


def test_what_is_worn_fades_as_fast_at_any_frame_rate(p01: Identity, monkeypatch: pytest.MonkeyPatch) -> None:
    shape = p01.reference.points * (64 / p01.reference.resolution)
    seconds, left = 0.6, []
    for rate in (25, 30, 60):
        watch = Watch(p01, watches_eyes=False)
        fringe = fake_parsing(FaceClass.HAIR, slice(0, 64), slice(0, 30))
        monkeypatch.setattr(cover, "parse_frame", lambda *_, parsing=fringe: parsing)
        hidden = watch(BLACK, shape, seconds=1 / rate)
        assert hidden is not None
        assert hidden.min() < 0.01
        bare = fake_parsing(FaceClass.SKIN, slice(0, 64), slice(0, 64))
        monkeypatch.setattr(cover, "parse_frame", lambda *_, parsing=bare: parsing)
        for _ in range(round(seconds * rate)):
            fading = watch(BLACK, shape, seconds=1 / rate)
        assert fading is not None
        left.append(float(fading.min()))
    assert left[1] == pytest.approx(1 - LIMITS.memory.over(seconds), abs=0.01)
    assert left == pytest.approx([left[1]] * 3, abs=0.01)
