"""The model file: what comes back, and the sentence for every file that cannot be used."""

import json
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from safetensors import safe_open
from safetensors.numpy import save_file

from guise.aam.appearance import Components
from guise.aam.model import COMPACT_VERSION, FORMAT, VERSION, Identity, ModelError
from guise.aam.person_tracker import PersonTracker
from guise.aam.tracker import Fit
from guise.common.errors import GuiseError


@pytest.fixture(scope="module")
def saved(p01: Identity, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "p01.guise"
    p01.save(path)
    return path


@pytest.fixture(scope="module")
def loaded(saved: Path) -> Identity:
    return Identity.load(saved)


def rewritten(saved: Path, out: Path, drop: str = "", **changes: str) -> Path:
    """A copy of a model with parts of its header changed, or a tensor dropped."""
    with safe_open(saved, "np") as file:
        tensors = {k: file.get_tensor(k) for k in file.keys() if k != drop}  # noqa: SIM118
        header = {**file.metadata(), **changes}
    save_file(tensors, out, header)
    return out


def assert_same_components(a: Components, b: Components) -> None:
    """Alike but for the basis, which is stored in half precision."""
    assert_array_equal(a.mean, b.mean)
    assert_array_equal(a.deviations, b.deviations)
    assert a.total_variance == b.total_variance
    assert_allclose(a.basis, b.basis, atol=2e-3)
    assert_allclose(b.basis.T @ b.basis, np.eye(b.modes), atol=1e-5)


def test_what_was_saved_comes_back(p01: Identity, loaded: Identity) -> None:
    assert (loaded.name, loaded.reference.id, loaded.facts) == (p01.name, p01.reference.id, p01.facts)
    assert_same_components(p01.appearance.components, loaded.appearance.components)
    assert_same_components(p01.tracker.shapes, loaded.tracker.shapes)
    assert_same_components(p01.tracker.texture, loaded.tracker.texture)
    assert_array_equal(loaded.appearance.neutral, p01.appearance.neutral)
    assert_array_equal(loaded.appearance.mask, p01.appearance.mask)
    assert_array_equal(loaded.tracker.pixels, p01.tracker.pixels)
    assert astuple(loaded.tracker.quality) == astuple(p01.tracker.quality)
    assert_array_equal(loaded.tracker.box_to_shape, p01.tracker.box_to_shape)
    assert len(loaded.tracker.stages) == len(p01.tracker.stages)
    for a, b in zip(p01.tracker.stages, loaded.tracker.stages, strict=True):
        assert_allclose(a, b, rtol=2e-3, atol=1e-4)
    assert_allclose(loaded.detail, p01.detail.clip(-63.5, 63.5), atol=0.25)


def test_the_still_comes_back_nearly_unchanged(p01: Identity, loaded: Identity) -> None:
    assert_array_equal(loaded.rest_frame.shape, p01.rest_frame.shape)
    assert loaded.rest_frame.picture.shape == p01.rest_frame.picture.shape
    off = np.abs(loaded.rest_frame.picture.astype(float) - p01.rest_frame.picture)
    assert off.mean() < 2


def test_a_loaded_tracker_tracks_like_the_one_saved(
    p01: Identity, loaded: Identity, talk2: tuple[list[np.ndarray], np.ndarray]
) -> None:
    luma, truth = talk2[0][0], talk2[1][0]
    before, after = (identity.tracker.fit(luma, truth + 3) for identity in (p01, loaded))
    assert isinstance(before, Fit)
    assert isinstance(after, Fit)
    assert_allclose(after.shape, before.shape, atol=0.05)


def test_saving_again_changes_nothing(loaded: Identity, saved: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.guise"
    assert loaded.save(again) == again.stat().st_size
    assert_same_components(loaded.appearance.components, Identity.load(again).appearance.components)
    assert list(tmp_path.iterdir()) == [again]  # nothing like again.guise.part


def test_nothing_is_left_when_writing_fails(p01: Identity, tmp_path: Path) -> None:
    (tmp_path / "taken.guise").mkdir()
    with pytest.raises(OSError):  # noqa: PT011, the text is the system's
        p01.save(tmp_path / "taken.guise")
    assert [p.name for p in tmp_path.iterdir()] == ["taken.guise"]


def message(path: Path) -> str:
    with pytest.raises(ModelError) as caught:
        Identity.load(path)
    return str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    path = tmp_path / "nobody.guise"
    assert message(path) == f"there is no model file {path}; make one with: guise enroll VIDEO -o {path}"


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.5, 0.999])
def test_truncated_file(saved: Path, tmp_path: Path, share: float) -> None:
    path, data = tmp_path / "half.guise", saved.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    assert message(path) == f"{path} is not a Guise model or is truncated; enroll the person again"


def test_not_a_model_at_all(tmp_path: Path) -> None:
    path = tmp_path / "notes.guise"
    path.write_text("these are not the weights you are looking for\n" * 20)
    assert message(path) == f"{path} is not a Guise model or is truncated; enroll the person again"


def test_safetensors_of_something_else(tmp_path: Path) -> None:
    path = tmp_path / "other.guise"
    save_file({"weights": np.zeros(3, np.float32)}, path, {"format": "pt"})
    assert message(path) == f"{path} is not a Guise model; make one with: guise enroll VIDEO -o NAME.guise"
    save_file({"weights": np.zeros(3, np.float32)}, path)
    assert message(path) == f"{path} is not a Guise model; make one with: guise enroll VIDEO -o NAME.guise"


def test_other_version(saved: Path, tmp_path: Path) -> None:
    path = rewritten(saved, tmp_path / "future.guise", version="99")
    assert message(path) == (
        f"{path} has model format 99, this Guise reads formats {VERSION} and {COMPACT_VERSION}; enroll the person again"
    )


def test_other_reference_frame(saved: Path, p01: Identity, tmp_path: Path) -> None:
    wanted = json.dumps({"scheme": "face81", "resolution": 96, "id": "0123456789ab"})
    path = rewritten(saved, tmp_path / "other.guise", reference=wanted)
    assert message(path) == (
        f"{path} was enrolled on reference frame 0123456789ab, this Guise has {p01.reference.id}; "
        "enroll the person again"
    )


@pytest.mark.parametrize(
    "reference",
    ["{}", "not JSON", '{"resolution": 9999, "id": ""}', '{"resolution": 1e999, "id": ""}', "[]", "null"],
)
def test_unusable_reference(saved: Path, tmp_path: Path, reference: str) -> None:
    path = rewritten(saved, tmp_path / "odd.guise", reference=reference)
    assert message(path) == f"{path} is damaged (no usable reference frame); enroll the person again"


@pytest.mark.parametrize(
    "tensor",
    ["neutral", "mask", "appearance.basis", "tracker.quality", "still.jpeg", "detail", "tracker.stage1"],
)
def test_missing_part(saved: Path, tmp_path: Path, tensor: str) -> None:
    path = rewritten(saved, tmp_path / "part.guise", drop=tensor)
    assert message(path).startswith(f"{path} is damaged (")
    assert message(path).endswith("); enroll the person again")


@pytest.mark.parametrize(
    "tensor", ["neutral", "mask", "detail", "appearance.basis", "tracker.stage1", "tracker.box_to_shape"]
)
def test_part_of_another_length(saved: Path, tmp_path: Path, tensor: str) -> None:
    path = tmp_path / "short.guise"
    with safe_open(saved, "np") as file:
        tensors = {k: file.get_tensor(k) for k in file.keys()}  # noqa: SIM118
        tensors[tensor] = np.ascontiguousarray(tensors[tensor][:-1])
        save_file(tensors, path, file.metadata())
    assert message(path).startswith(f"{path} is damaged ({tensor} is (")


def test_the_header_can_be_read_by_anyone(saved: Path) -> None:
    with safe_open(saved, "np") as file:
        header = file.metadata()
    assert header["format"] == FORMAT
    assert header["version"] == str(VERSION)
    assert json.loads(header["facts"])["clips"] == ["talk.mp4"]


def test_a_model_made_with_other_facts_keeps_them(p01: Identity, tmp_path: Path) -> None:
    replace(p01, name="Zoë", facts={"note": "ünïcode"}).save(tmp_path / "z.guise")
    back = Identity.load(tmp_path / "z.guise")
    assert (back.name, back.facts) == ("Zoë", {"note": "ünïcode"})


def test_the_same_model_is_the_same_bytes(p01: Identity, tmp_path: Path) -> None:
    written = []
    for name in ("a.guise", "b.guise"):
        p01.save(tmp_path / name)
        written.append((tmp_path / name).read_bytes())
    assert written[0] == written[1]


def test_a_compact_file_holds_the_same_face_in_less(saved: Path, tmp_path: Path) -> None:
    whole = Identity.load(saved)
    path = tmp_path / "donor.guise"
    size = whole.for_display().save(path, compact=True)
    donor = Identity.load(path)
    assert size < 0.65 * saved.stat().st_size
    assert np.abs(donor.appearance.neutral - whole.appearance.neutral).max() <= 0.125
    assert np.array_equal(donor.appearance.mask, whole.appearance.mask)
    off = np.linalg.norm(donor.appearance.components.basis - whole.appearance.components.basis, axis=0)
    assert off.max() < 0.1
    assert len(donor.tracker.pixels) == 0


def test_a_donor_is_not_tracked(saved: Path) -> None:
    with pytest.raises(GuiseError, match="can be shown but not tracked"):
        PersonTracker(Identity.load(saved).for_display().tracker, None)


def test_an_identity_says_what_it_is_in_one_line(saved: Path) -> None:
    text = str(Identity.load(saved))
    assert text.startswith("p01: ")
    assert "96 pixels across the face" in text
    assert "\n" not in text
