"""Models of different resolutions are mixed: shapes scale, textures are resampled, modes stay orthonormal."""

import numpy as np
import pytest
from models import model_file

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.resampling import resampled, resampled_detail


@pytest.fixture(scope="module")
def person() -> Identity:
    return Identity.load(model_file("p06"))


@pytest.mark.parametrize("resolution", [96, 160])
def test_the_neutral_shape_keeps_its_place_on_the_face(person: Identity, resolution: int) -> None:
    reference = ReferenceFrame.canonical(resolution)
    model = resampled(person.appearance, reference)
    scale = resolution / person.reference.resolution
    away = (person.appearance.neutral_shape - person.reference.points) * scale
    assert np.abs(model.neutral_shape - reference.points - away).max() < 0.5 * scale


@pytest.mark.parametrize("resolution", [96, 160])
def test_modes_are_orthonormal_and_span_the_same_variance(person: Identity, resolution: int) -> None:
    model = resampled(person.appearance, ReferenceFrame.canonical(resolution))
    basis = model.components.basis.astype(np.float64)
    assert np.abs(basis.T @ basis - np.eye(basis.shape[1])).max() < 1e-5
    assert (np.diff(model.components.deviations) <= 0).all()
    assert model.components.retained == pytest.approx(person.appearance.components.retained, abs=1e-6)


def test_there_and_back_changes_a_texture_little(person: Identity) -> None:
    back = resampled(resampled(person.appearance, ReferenceFrame.canonical(200)), person.reference)
    inside = person.appearance.mask[person.reference.mask]
    off = np.abs(back.neutral_texture - person.appearance.neutral_texture)[inside]
    assert off.mean() < 3.0
    assert np.abs(back.neutral[:SHAPE_ENTRIES] - person.appearance.neutral[:SHAPE_ENTRIES]).max() < 1e-1


def test_a_mode_moves_the_resampled_face_as_it_moved_the_old_one(person: Identity) -> None:
    old, reference = person.appearance, ReferenceFrame.canonical(160)
    model = resampled(old, reference)
    moved = old.neutral + 2 * old.components.deviations[0] * old.components.basis[:, 0]
    wanted = (old.shape_of(moved) - old.neutral_shape) * 160 / old.reference.resolution
    seen = resampled(type(old)(old.reference, old.components, moved, old.mask), reference)
    away = seen.neutral - model.neutral
    kept = model.components.basis @ (model.components.basis.T @ away)
    assert np.linalg.norm(kept - away) < 0.02 * np.linalg.norm(away)
    assert (
        np.abs(seen.neutral_shape - model.neutral_shape - wanted).max() < 0.02 * np.abs(wanted).max() + 1e-3
    )


def test_the_same_frame_gives_the_same_model(person: Identity) -> None:
    assert resampled(person.appearance, person.reference) is person.appearance


def test_detail_follows_the_grid(person: Identity) -> None:
    reference = ReferenceFrame.canonical(160)
    h, w = reference.size
    assert resampled_detail(person.detail, person.reference, reference).shape == (2 * h, 2 * w)
