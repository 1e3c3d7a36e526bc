"""Expression transfer onto the identity's own still."""

from pathlib import Path

import numpy as np
import pytest
from clips import cut, pictures, tags
from models import model_file

from guise.aam.landmarks import LbpDetector
from guise.aam.landmarks.schemes import (
    LIPS,
    LOWER_INNER_LIP,
    LOWER_LIP_BOTTOM,
    LOWER_LIP_INNER,
    UPPER_INNER_LIP,
    UPPER_LIP_INNER,
    UPPER_LIP_TOP,
)
from guise.aam.model import Identity, RestFrame
from guise.aam.reference import ReferenceFrame
from guise.app.media import Frame, open_input
from guise.app.swapping.puppet import PINNED_POINTS, PoseRemover, Puppet, fitted, puppet_file, uncrossed


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


@pytest.fixture(scope="module")
def p06() -> Identity:
    return Identity.load(model_file("p06"))


def test_at_the_drivers_neutral_the_mesh_is_the_stills_own(p01: Identity, p06: Identity) -> None:
    with Puppet(p01, p06, LbpDetector()) as puppet:
        at_rest = puppet.plan.texture.extrapolator.apply(p01.appearance.neutral_parameters)
        np.testing.assert_allclose(puppet.mesh(at_rest), uncrossed(p06.rest_frame.shape), atol=1e-6)


def test_skull_points_stay_and_the_jaw_moves(p01: Identity, p06: Identity) -> None:
    rng = np.random.default_rng(0)
    deviations = p01.appearance.components.deviations
    with Puppet(p01, p06, LbpDetector()) as puppet:
        for _ in range(5):
            rho = p01.appearance.neutral_parameters + rng.normal(size=len(deviations)) * deviations
            mesh = puppet.mesh(puppet.plan.texture.extrapolator.apply(rho.astype(np.float32)))
            np.testing.assert_allclose(mesh[PINNED_POINTS], p06.rest_frame.shape[PINNED_POINTS], atol=1e-9)
            assert np.abs(mesh[6:11] - p06.rest_frame.shape[6:11]).max() > 0.05


def test_turns_are_removed_and_expressions_kept() -> None:
    frame = ReferenceFrame.canonical(64)
    remover = PoseRemover(frame)
    turn = 12 * frame.yaw_mode + (0.7, -0.4) + 0.03 * (frame.points - frame.points.mean(0))
    assert np.abs(turn).max() > 3
    x_only = turn * [1, 0] + (0, -0.4) + 0.03 * (frame.points - frame.points.mean(0)) * [0, 1]
    assert np.abs(remover.without(x_only)).max() < 0.05
    smile = np.zeros((81, 2))
    smile[LIPS, 1] = 3.0
    np.testing.assert_allclose(remover.without(smile)[LIPS], smile[LIPS], atol=1e-3)


def test_outside_the_surroundings_the_still_is_untouched(
    p01: Identity, p06: Identity, tmp_path: Path
) -> None:
    clip = cut("p01", tmp_path / "clip.mp4", 6)
    with open_input(clip) as source, Puppet(p01, p06, LbpDetector()) as puppet:
        made = [(frame, puppet.swap(frame).outcome) for frame in source]
    still = p06.rest_frame.picture
    for frame, outcome in made:
        assert outcome == "swapped"
        np.testing.assert_array_equal(frame.rgb()[:, :100], still[:, :100])
        assert (frame.rgb() != still).any()


def test_a_lost_driver_holds_the_expression(p01: Identity, p06: Identity) -> None:
    with Puppet(p01, p06, LbpDetector()) as puppet:
        first, second = (Frame.from_rgb(np.full((240, 320, 3), 80, np.uint8)) for _ in range(2))
        assert [puppet.swap(first).outcome, puppet.swap(second).outcome] == ["held", "held"]
    np.testing.assert_array_equal(first.rgb(), second.rgb())


def test_a_file_keeps_times_and_sound(p01: Identity, p06: Identity, tmp_path: Path) -> None:
    clip = cut("p01", tmp_path / "clip.mp4", 8)
    report = puppet_file(clip, p06, tmp_path / "out.mp4", source=p01)
    assert (report.frames, report.swapped) == (8, 8)
    assert pictures(tmp_path / "out.mp4")[0].shape == p06.rest_frame.picture.shape[:2]
    assert tags(tmp_path / "out.mp4")["comment"].startswith("Synthetic face")
    with open_input(clip) as old, open_input(tmp_path / "out.mp4") as new:
        assert new.has_audio
        assert [f.pts * f.time_base for f in new] == [f.pts * f.time_base for f in old]


@pytest.mark.parametrize(("size", "expected"), [((97, 131), (96, 132)), ((2160, 3840), (1080, 1920))])
def test_a_still_is_even_and_not_too_tall(size: tuple[int, int], expected: tuple[int, int]) -> None:
    height, width = size
    corners = np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]])
    made = fitted(RestFrame(np.zeros((height, width, 3), np.uint8), corners))
    assert made.picture.shape == (*expected, 3)
    np.testing.assert_allclose(made.shape[1], np.array(expected[::-1]) - 0.5)


def test_lips_meet_but_do_not_cross() -> None:
    frame = ReferenceFrame.canonical(64)
    mesh = frame.points.copy()
    mesh[UPPER_INNER_LIP, 1] = mesh[LOWER_INNER_LIP, 1] + 2
    out = uncrossed(mesh)
    down = mesh[LOWER_LIP_BOTTOM] - mesh[UPPER_LIP_TOP]
    assert ((out[LOWER_INNER_LIP] - out[UPPER_INNER_LIP]) @ down).min() > -1e-9
    np.testing.assert_allclose(
        out[UPPER_LIP_INNER] + out[LOWER_LIP_INNER], mesh[UPPER_LIP_INNER] + mesh[LOWER_LIP_INNER]
    )
    np.testing.assert_array_equal(uncrossed(out).round(9), out.round(9))
