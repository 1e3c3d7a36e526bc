"""Choice of frames, what a frame is reduced to, and what a trained model holds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import SAMPLES
from numpy.testing import assert_allclose, assert_array_equal

from guise.aam.appearance import SHAPE_ENTRIES, openness
from guise.aam.landmarks.schemes import INNER_LIPS
from guise.aam.light import equalised_light
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.solid_shape import SolidPrior, facing
from guise.aam.tracker import Crop
from guise.aam.training import (
    LIMITS,
    Observation,
    TrainingError,
    TrainingOptions,
    choose_frames,
    detailed,
    held_out_error,
    observe,
    train_identity,
    with_what_faced,
    without_hair,
)

Talk = tuple[list[np.ndarray], np.ndarray]
FRAME = ReferenceFrame.canonical(64)


@pytest.fixture(scope="module")
def shapes() -> np.ndarray:
    return np.load(SAMPLES / "p01" / "talk.npz")["landmarks"].astype(float)


def spread(shapes: np.ndarray) -> float:
    """How far frames lie apart on average: mean distance to the nearest other, aligned, grid pixels."""
    aligned = np.stack([FRAME.align(s) for s in shapes]).reshape(len(shapes), -1)
    distance = np.linalg.norm(aligned[:, None] - aligned, axis=2) + np.diag(np.full(len(shapes), np.inf))
    return float(distance.min(1).mean())


def test_chosen_frames_differ_more_than_frames_even_in_time(shapes: np.ndarray) -> None:
    chosen = choose_frames(shapes, TrainingOptions(frames=40)).training
    even = np.linspace(0, len(shapes) - 1, len(chosen)).round().astype(int)
    assert spread(shapes[chosen]) > 1.2 * spread(shapes[even])


def test_chosen_frames_hold_the_extremes(shapes: np.ndarray) -> None:
    chosen = choose_frames(shapes, TrainingOptions(frames=40)).training
    openings = openness(shapes)
    assert openings[chosen, 0].max() > 0.9 * openings[:, 0].max()
    assert openings[chosen, 1].min() < openings[:, 1].min() + 0.02
    yaw = np.array([FRAME.yaw(FRAME.align(s)) for s in shapes])
    assert np.ptp(yaw[chosen]) > 0.9 * np.ptp(yaw)


@pytest.mark.parametrize("frames", [20, 40, 100])
def test_about_as_many_frames_as_asked_for_and_none_twice(shapes: np.ndarray, frames: int) -> None:
    choice = choose_frames(shapes, TrainingOptions(frames=frames))
    assert 0.75 * frames <= len(choice.training) <= frames + 1
    assert len(np.unique(choice.training)) == len(choice.training)
    assert_array_equal(
        choice.all, np.unique(np.concatenate([choice.training, choice.neutral, choice.held_out]))
    )


def test_held_out_frames_are_not_trained_on(shapes: np.ndarray) -> None:
    choice = choose_frames(shapes, TrainingOptions(frames=60))
    assert len(choice.held_out) > 20
    assert not set(choice.held_out) & set(choice.training)


def test_neutral_frames_have_a_closed_mouth(shapes: np.ndarray) -> None:
    choice = choose_frames(shapes, TrainingOptions())
    mouth = openness(shapes)[:, 0]
    assert mouth[choice.neutral].max() < np.quantile(mouth, 0.2)


@given(st.sets(st.integers(0, 299), min_size=1, max_size=150))
@pytest.mark.slow
def test_frames_without_a_face_are_never_chosen(missing: set[int]) -> None:
    shapes = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"].astype(float)
    shapes[list(missing)] = np.nan
    assert not missing & set(choose_frames(shapes, TrainingOptions(frames=30)).all.tolist())


def test_one_missing_point_makes_a_frame_unusable(shapes: np.ndarray) -> None:
    holed = shapes.copy()
    holed[:, 70, 1] = np.nan
    holed[::5] = shapes[::5]
    assert (choose_frames(holed, TrainingOptions()).all % 5 == 0).all()


def test_a_slip_of_a_single_frame_is_left_out(shapes: np.ndarray) -> None:
    index = int(choose_frames(shapes, TrainingOptions()).training[30])
    slipped = shapes.copy()
    slipped[index] += [60, -40]
    assert index not in choose_frames(slipped, TrainingOptions()).all


def test_faces_of_few_pixels_are_left_out(shapes: np.ndarray) -> None:
    small = shapes.copy()
    small[100:] *= 15 / np.ptp(shapes[..., 0], axis=1).max()
    assert choose_frames(small, TrainingOptions()).all.max() < 100


@pytest.mark.parametrize("count", [0, 1, LIMITS.min_frames - 1])
def test_too_few_frames(shapes: np.ndarray, count: int) -> None:
    rare = np.full_like(shapes, np.nan)
    rare[:count] = shapes[:count]
    with pytest.raises(TrainingError) as caught:
        choose_frames(rare, TrainingOptions())
    assert str(caught.value) == (
        f"a model needs at least 12 frames with a face, got {count}; use a longer or clearer clip"
    )


def test_just_enough_frames(shapes: np.ndarray) -> None:
    assert (
        len(choose_frames(shapes[: LIMITS.min_frames + 4], TrainingOptions()).training) >= LIMITS.min_frames
    )


def colour(luma: np.ndarray) -> np.ndarray:
    return np.repeat(luma[..., None], 3, axis=2)


def test_a_frame_is_reduced_to_texture_and_crop(talk2: Talk) -> None:
    picture, shape = colour(talk2[0][0]), talk2[1][0]
    seen = observe(picture, shape, FRAME)
    assert isinstance(seen, Observation)
    assert seen.texture.shape == (len(FRAME.pixels), 3)
    assert seen.picture is None
    assert seen.crop.image.nbytes < picture.nbytes / 20
    kept = observe(picture, shape, FRAME, keep_picture=True)
    assert isinstance(kept, Observation)
    assert_array_equal(kept.picture, picture)


def test_a_face_outside_the_picture_is_a_reason_not_an_error(talk2: Talk) -> None:
    assert observe(colour(talk2[0][0]), talk2[1][0] + 5000, FRAME) == Failed("the face has left the picture")


def test_held_out_error_is_that_of_the_tracker(p01: Identity, talk2: Talk) -> None:
    seen = [observe(colour(g), s, FRAME) for g, s in zip(talk2[0][:20:2], talk2[1][:20:2], strict=True)]
    observations = [o for o in seen if isinstance(o, Observation)]
    assert 0 < held_out_error(p01.tracker, observations) < 0.02
    assert np.isnan(held_out_error(p01.tracker, []))


def test_training_reports_that_frames_are_not_enough(shapes: np.ndarray, talk2: Talk) -> None:
    choice = choose_frames(shapes, TrainingOptions(frames=20))
    seen = observe(colour(talk2[0][0]), talk2[1][0], ReferenceFrame.canonical(96))
    assert isinstance(seen, Observation)
    few = {int(i): seen for i in choice.training[:5]}
    with pytest.raises(
        TrainingError,
        match="only 5 of the chosen frames show the whole face, 12 are needed; use another clip",
    ):
        train_identity("nobody", few, choice, options=TrainingOptions(frames=20, resolution=96))


def test_a_model_holds_what_was_asked_for(p01: Identity) -> None:
    assert p01.reference.id == ReferenceFrame.canonical(96).id
    assert 30 <= p01.facts["frames"] <= 41
    assert p01.appearance.components.retained >= 0.98 or p01.appearance.components.modes == 40
    assert p01.detail.shape == tuple(2 * side for side in p01.reference.size)
    assert p01.facts["held_out_error"] == p01.tracker.quality.error


def test_the_neutral_face_of_a_model_has_a_closed_mouth(p01: Identity, shapes: np.ndarray) -> None:
    mouth = openness(p01.appearance.neutral_shape[None])[0, 0]
    assert mouth < np.quantile(openness(shapes)[:, 0], 0.2)
    assert mouth < openness(p01.appearance.shape_of(p01.appearance.components.mean)[None])[0, 0]


def test_detail_is_what_the_grid_is_too_coarse_for(p01: Identity) -> None:
    """Only high frequencies: little is left of it after a blur that the grid could show."""
    import cv2

    size = p01.detail.shape[::-1]
    face = cv2.resize(p01.appearance.mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    blurred = cv2.GaussianBlur(p01.detail, (0, 0), 4)
    assert p01.detail[face].std() > 0.5
    assert blurred[face].std() < 0.25 * p01.detail[face].std()
    assert_allclose(p01.detail[face].mean(), 0, atol=0.2)


def test_in_equalised_light_a_face_is_the_same_under_any_light() -> None:
    frame = ReferenceFrame.canonical(48)
    rng = np.random.default_rng(0)
    face = rng.uniform(60, 160, (len(frame.pixels), 3)).astype(np.float32)
    face += 25 * np.sin(frame.pixels / 7)[:, None].astype(np.float32)
    across = (frame.pixels % frame.size[1] / frame.size[1])[:, None]
    lights = [np.ones_like(across), np.full_like(across, 0.5), 0.6 + 0.8 * across, 1.3 - 0.7 * across]
    lit = np.stack([face * light for light in lights]).astype(np.float32)
    equalised = equalised_light(lit, skin_mask(frame)[frame.mask], frame)
    assert equalised.std(0).mean() < 0.15 * lit.std(0).mean()


def test_equalised_light_leaves_what_light_cannot_do() -> None:
    frame = ReferenceFrame.canonical(48)
    face = np.full((2, len(frame.pixels), 3), 120, np.float32)
    mouth = soft_parts(frame, (INNER_LIPS,), 0.0)[frame.mask] > 0.5
    face[1, mouth] = 30
    equalised = equalised_light(face, skin_mask(frame)[frame.mask], frame)
    np.testing.assert_allclose(equalised[1, mouth] - equalised[0, mouth], -90, atol=3)


def test_what_a_turned_head_hides_is_taken_from_frames_in_which_it_faced_the_camera() -> None:
    reference, prior = ReferenceFrame.canonical(64), SolidPrior.shipped()
    angles = np.radians([-50, -45, -40, -50, -45, 0, 5, -5])
    turns = [np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]]) for a in angles]
    shapes = np.array([(prior.mean @ turn.T)[:, :2] * 50 + 100 for turn in turns])
    cosines = np.array([facing(fit.rest, fit.pose.rotation) for fit in map(prior.fit, shapes)])
    sampler = reference.sampler
    faced = (cosines[:, sampler.vertices] * sampler.weights).sum(1)
    skin = np.float32([180, 140, 120])
    textures = np.where((faced > 0.3)[..., None], skin, np.float32([20, 200, 20]))
    made = with_what_faced(np.float32(textures.mean(0)), textures.astype(np.float32), shapes, reference)
    hidden = (faced[:5] < 0.1).all(0) & (faced[5:] > 0.5).all(0)
    assert hidden.sum() > 20
    assert np.abs(textures.mean(0)[hidden] - skin).max() > 50
    assert np.abs(made[hidden] - skin).max() < 15
    straight = with_what_faced(textures[5], textures[5:6].repeat(8, 0), shapes[5:6].repeat(8, 0), reference)
    assert_allclose(straight, textures[5], atol=1e-3)


def test_hair_in_the_frames_does_not_bend_the_face_beside_it(p01: Identity) -> None:
    reference, rest = p01.reference, p01.rest_frame
    columns = np.arange(reference.size[1]) / reference.size[1]
    face = p01.appearance.mask & (columns > 0.3)

    def neutral(picture: np.ndarray) -> np.ndarray:
        vector = p01.appearance.neutral.copy()
        vector[SHAPE_ENTRIES:] = reference.sampler.sample(picture, rest.shape).ravel()
        appearance = replace(p01.appearance, neutral=vector, mask=face)
        crop = Crop(picture[..., 0], np.ones(2), np.zeros(2))  # not looked at
        frame = Observation(
            vector[SHAPE_ENTRIES:].reshape(-1, 3), crop, rest.shape, (picture, rest.shape), picture
        )
        return reference.scatter(detailed(appearance, [frame])[0].neutral_texture)

    hairy = rest.picture.copy()
    hairy[:, : int(rest.shape[:, 0].min() + 0.3 * np.ptp(rest.shape[:, 0]))] = 15
    plain, made = neutral(rest.picture), neutral(hairy)
    assert np.abs(made - plain)[face & (columns > 0.36)].mean() < 1
    assert made[p01.appearance.mask & ~face].mean() > 0.7 * plain[face].mean()


def test_shade_beside_hair_goes_on_where_the_hair_was() -> None:
    reference = ReferenceFrame.canonical(160)
    columns = np.arange(reference.size[1]) / reference.size[1]
    shade = np.interp(columns, (0.1, 0.3), (0.6, 1.0)).astype(np.float32)  # of the side of a face
    skin = np.float32([200, 160, 140]) * np.tile(shade[:, None], (reference.size[0], 1, 1))
    face = reference.mask & (columns > 0.15)
    hairy = np.where(face[..., None], skin, np.float32(20))
    made = reference.scatter(without_hair(hairy[reference.mask], face, reference))[..., 0]
    beside = reference.mask & (columns > 0.1) & (columns < 0.14)
    assert 120 < made[beside].mean() < 170  # the shade at its edge is 140, the skin 200
