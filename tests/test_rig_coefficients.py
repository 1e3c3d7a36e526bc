"""ARKit's coefficients: names, filter, calibration, the estimator on a rendered clip, and the rig that ships."""

from pathlib import Path

import numpy as np
import pytest

from guise.aam.rig.calibration import CalibrationError, Calibrator, fit_map, load, save
from guise.aam.rig.coefficients import (
    LOOKS,
    TOLD,
    Coefficients,
    OneEuro,
    RigCalibration,
    RigEstimator,
    coefficients,
    shipped,
    smoothed,
)
from guise.aam.rig.names import ARKIT_NAMES, FULL_LOOK_DEGREES, INDEX
from guise.analogy.formats.files import Rig, read_rig
from guise.app.media import open_input
from guise.common.arrays import F64, U8

SAMPLES = Path(__file__).parents[1] / "sample_videos"


@pytest.fixture(scope="module")
def clip() -> tuple[list[U8], F64, F64]:
    """Some frames of a rendered clip, their points and their yaw."""
    with np.load(SAMPLES / "p06" / "talk.npz") as truth:
        points, yaw = truth["landmarks"], truth["yaw_pitch_roll_deg"][:, 0]
    pictures = []
    with open_input(SAMPLES / "p06" / "talk.mp4") as source:
        for number, frame in enumerate(source):
            pictures.append(frame.rgb().copy())
            if number == 40:
                break
    return pictures, points[:41].astype(np.float64), yaw[:41]


@pytest.fixture(scope="module")
def rig() -> Rig:
    return read_rig(SAMPLES / "heads" / "arkit.glb")


def test_there_are_52_names_each_left_with_its_right() -> None:
    assert len(set(ARKIT_NAMES)) == 52
    assert {n.removesuffix("Left") for n in ARKIT_NAMES if n.endswith("Left")} == {
        n.removesuffix("Right") for n in ARKIT_NAMES if n.endswith("Right")
    }
    assert len(TOLD) == 44


def test_looks_become_the_eyes_turn_and_eight_coefficients() -> None:
    told = np.zeros(len(TOLD) + len(LOOKS))
    told[-2:] = 0.5, -0.25  # to the person's left, and down
    found = coefficients(told, np.zeros(3)).named
    looks = {name: value for name, value in found.items() if value}
    assert looks == {
        "eyeLookOutLeft": 0.5, "eyeLookInRight": 0.5, "eyeLookDownLeft": 0.25, "eyeLookDownRight": 0.25,
    }  # fmt: skip


def test_the_filter_lags_by_less_than_a_frame_and_holds_what_is_still() -> None:
    smooth, still = OneEuro(), OneEuro()
    frames = np.arange(20)
    found = np.array([smooth(np.array([0.1 * k]), k / 30)[0] for k in frames])
    assert 0.1 * frames[-1] - found[-1] < 0.1
    noise = 0.01 * np.random.default_rng(0).standard_normal(200)
    held = np.array([still(np.array([x]), k / 30)[0] for k, x in enumerate(noise)])
    assert held[20:].std() < 0.75 * noise.std()


def test_a_whole_clip_is_smoothed_without_any_lag() -> None:
    pulse = np.maximum(0, 1 - np.abs(np.arange(41) - 20) / 5)[:, None]
    found = smoothed(pulse, np.arange(41) / 30)
    assert np.allclose(found, found[::-1])
    assert 0.5 < found[20, 0] < 1


def test_a_map_learns_the_gain_of_a_person_and_nothing_from_nothing() -> None:
    rng = np.random.default_rng(1)
    truth = np.abs(rng.standard_normal((400, 46)))
    told, away = 0.6 * truth + 0.1, rng.standard_normal((400, 5))
    learnt = fit_map(told, away, truth)
    mapped = np.column_stack([told, np.ones(len(told)), away]) @ learnt
    assert np.abs(mapped - truth).mean() < 0.5 * np.abs(told - truth).mean()
    assert np.allclose(fit_map(told[:0], away[:0], truth[:0]), np.eye(52, 46), atol=1e-6)


def test_a_face_gives_coefficients_in_range_and_the_turn_of_its_head(clip: tuple[list[U8], F64, F64]) -> None:
    estimator = RigEstimator()
    found = [estimator(rgb, points, k / 30) for k, (rgb, points) in enumerate(zip(*clip[:2], strict=True))]
    weights = np.array([one.weights for one in found])
    assert weights.dtype == np.float32
    assert weights.min() >= 0
    assert weights.max() <= 1
    yaw = np.array([one.head[0] for one in found])
    assert np.abs(yaw - clip[2])[5:].mean() < 6
    assert np.corrcoef(yaw, clip[2])[0, 1] > 0.8


def test_a_calibration_gives_nothing_at_rest_and_is_the_same_when_read(
    clip: tuple[list[U8], F64, F64], tmp_path: Path
) -> None:
    pictures, points, _ = clip
    calibrator = Calibrator()
    with pytest.raises(CalibrationError, match="at rest"):
        calibrator.result()
    for rgb, place in zip(pictures[:3], points[:3], strict=True):
        calibrator.see(rgb, place, "rest")
    made = calibrator.result()
    save(made, tmp_path / "me.npz")
    again = load(tmp_path / "me.npz")
    found: list[Coefficients] = []
    for calibration in (made, again):
        found.append(RigEstimator(calibration)(pictures[0], points[0], 0.0))
    assert np.array_equal(found[0].weights, found[1].weights)
    faces = [k for k in range(52) if not ARKIT_NAMES[k].startswith("eyeLook")]
    assert found[0].weights[faces].sum() < 0.8
    (tmp_path / "other.npz").write_bytes(b"no")
    with pytest.raises(CalibrationError, match="cannot use"):
        load(tmp_path / "other.npz")
    np.savez(tmp_path / "old.npz", rest=np.zeros(3), linear=np.zeros(0))
    with pytest.raises(CalibrationError, match="another version"):
        load(tmp_path / "old.npz")
    assert RigCalibration(made.rest).linear is None
    assert made.rest.shape == (shipped().size,)


def test_the_rig_has_all_shapes_and_each_moves_its_own_side(rig: Rig) -> None:
    rest = rig.file.mesh.vertices
    assert rig.names == ARKIT_NAMES
    for name, shape in zip(rig.names, rig.shapes, strict=True):
        far = np.linalg.norm(shape - rest, axis=1)
        assert far.max() > 1e-3, name  # a millimetre
        side = name.endswith("Left") - name.endswith("Right")
        if side and not name.startswith(("jaw", "mouthLeft", "mouthRight")):
            assert far[side * rest[:, 0] < -0.015].max() < 1e-4, name


def test_the_rigs_eyeballs_turn_without_changing_their_shape_to_first_order(rig: Rig) -> None:
    rest = rig.file.mesh.vertices
    moved = rig.shapes[INDEX["eyeLookOutLeft"]] - rest
    ball = np.linalg.norm(moved, axis=1) > 1e-5
    assert rest[ball, 0].min() > 0
    centre = rest[ball].mean(0)
    radius = np.linalg.norm(rest[ball] - centre, axis=1)
    full = np.linalg.norm(rest[ball] + moved[ball] - centre, axis=1)
    assert np.abs(full - radius).max() < 1e-4
    assert moved[ball].max() < 2 * radius.max() * np.sin(np.radians(FULL_LOOK_DEGREES / 2)) + 1e-4
