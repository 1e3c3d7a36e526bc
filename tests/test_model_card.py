"""What the cards of all models that users bring have in common, and how such a model is fed."""

from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from test_landmarks_onnx import linear_model

from guise.aam.model_card import CardReader, ModelCard
from guise.aam.onnx_model import OnnxModel
from guise.common.errors import GuiseError

TEXT = 'model = "model.onnx"\n[input]\nsize = [4, 2]\n'


class GreyError(GuiseError):
    """The made-up card's error."""


class GreyCard(ModelCard):
    """A made-up kind of card."""

    kind: ClassVar[str] = "grey"
    error: ClassVar[type[GuiseError]] = GreyError
    colours: ClassVar[tuple[str, ...]] = ("gray", "rgb")


def card(folder: Path, text: str = TEXT) -> GreyCard:
    (folder / "card.toml").write_text(text)
    return GreyCard(**CardReader(folder / "card.toml", GreyCard, {"": ("own",), "extra": ("key",)}).common())


def model(folder: Path, shape: tuple[int, ...]) -> None:
    count = int(np.prod(shape))
    (folder / "model.onnx").write_bytes(linear_model(shape, np.eye(count), np.zeros(count)))


def test_what_a_card_leaves_out_has_its_default(tmp_path: Path) -> None:
    read = card(tmp_path)
    assert (read.name, read.model, read.size, read.sha256) == ("card", tmp_path / "model.onnx", (4, 2), None)
    assert (read.colour, read.channels, read.layout, read.mean, read.scale) == (
        "gray",
        1,
        "nchw",
        (0,),
        (1 / 255,),
    )


def test_a_kind_of_card_may_have_its_own_keys_and_no_others(tmp_path: Path) -> None:
    card(tmp_path, "own = 1\n" + TEXT + "[extra]\nkey = 2\n")
    with pytest.raises(GreyError, match=r"grey card .*card.toml: \[extra\] may have key, got unknown lock"):
        card(tmp_path, TEXT + "[extra]\nlock = 2\n")
    with pytest.raises(GreyError, match=r"the top level may have name, model, .*own, got unknown other"):
        card(tmp_path, "other = 1\n" + TEXT)


def test_a_missing_card_is_an_error_of_its_kind(tmp_path: Path) -> None:
    with pytest.raises(GreyError, match=r"^grey card expected at .*none.toml, got no such file$"):
        CardReader(tmp_path / "none.toml", GreyCard)


def test_values_are_the_bytes_less_the_mean_times_the_scale(tmp_path: Path) -> None:
    model(tmp_path, (1, 2, 4, 3))
    text = TEXT + 'colour = "rgb"\nlayout = "nhwc"\nmean = [1, 2, 3]\nscale = 0.5\n'
    picture = np.random.default_rng(0).integers(0, 256, (2, 4, 3), np.uint8)
    given = OnnxModel(card(tmp_path, text))(picture)
    np.testing.assert_allclose(given.reshape(2, 4, 3), (picture.astype(float) - (1, 2, 3)) * 0.5)


def test_a_checksum_may_be_written_in_capitals(tmp_path: Path) -> None:
    import hashlib

    model(tmp_path, (1, 1, 2, 4))
    known = hashlib.sha256((tmp_path / "model.onnx").read_bytes()).hexdigest()
    OnnxModel(card(tmp_path, f'sha256 = "{known.upper()}"\n' + TEXT))
    with pytest.raises(
        GreyError, match=r"grey model .*model.onnx expected sha256 00, got .* another version\?$"
    ):
        OnnxModel(card(tmp_path, 'sha256 = "00"\n' + TEXT))


def test_a_model_of_another_size_is_refused_before_it_runs(tmp_path: Path) -> None:
    model(tmp_path, (1, 1, 2, 5))
    with pytest.raises(
        GreyError, match=r"describes float input \(1, 1, 2, 4\), got a model with .*\[1, 1, 2, 5\]"
    ):
        OnnxModel(card(tmp_path))
