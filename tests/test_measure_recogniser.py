"""Recogniser cards and models: what they say is done, and what is wrong in them is told."""

from pathlib import Path

import numpy as np
import pytest
from test_landmarks_onnx import linear_model
from test_measure import CARD, recogniser

from guise.aam.landmarks.schemes import LEFT_EYE, LEFT_MOUTH_CORNER, NOSE_TIP, RIGHT_EYE, RIGHT_MOUTH_CORNER
from guise.app.people.recogniser import Recogniser, RecogniserError, five_points, read_recogniser_card

ROOT = Path(__file__).parents[1]
MODEL = ROOT.parent / "shared" / "models" / "mobilefacenet.onnx"
REAL = ROOT.parent / "shared" / "data" / "real"
TEMPLATE = np.array([[5.3, 6.0], [10.7, 6.0], [8.0, 9.0], [5.8, 12.0], [10.2, 12.0]])


def landmarks(scale: float, x: float, y: float) -> np.ndarray:
    """Landmarks (81, 2) whose five points are the template's, enlarged and moved."""
    points = np.zeros((81, 2))
    five = scale * TEMPLATE + (x, y)
    (
        points[RIGHT_EYE],
        points[LEFT_EYE],
        points[NOSE_TIP],
        points[RIGHT_MOUTH_CORNER],
        points[LEFT_MOUTH_CORNER],
    ) = five
    return points


def reader(folder: Path, card: str = CARD) -> Recogniser:
    """A recogniser whose embedding is its whole input, first red, then green, then blue."""
    (folder / "projection.onnx").write_bytes(linear_model((1, 3, 16, 16), np.eye(768), np.zeros(768)))
    (folder / "card.toml").write_text(card)
    return Recogniser(folder / "card.toml")


def test_the_five_points_come_to_lie_on_the_template(tmp_path: Path) -> None:
    """A picture whose red grows to the right and green downwards is told by the position in the input."""
    y, x = np.mgrid[0:200, 0:200]
    rgb = np.stack([x, y, 0 * x], axis=2).astype(np.uint8)
    seen = reader(tmp_path)(rgb, landmarks(4.0, 20, 30))
    assert seen is not None
    red, green, _ = seen.reshape(3, 16, 16)
    expected_x = 4 * np.arange(16) + 20 - 127.5
    expected_y = 4 * np.arange(16)[:, None] + 30 - 127.5
    ratio = red[0, 0] / expected_x[0]
    assert np.allclose(red, ratio * expected_x, atol=abs(0.6 * ratio))
    assert np.allclose(green, ratio * expected_y, atol=abs(0.6 * ratio))


def test_colours_come_in_the_order_of_the_card(tmp_path: Path) -> None:
    rgb = np.zeros((100, 100, 3), np.uint8)
    rgb[..., 0] = 255
    points = landmarks(4.0, 10, 10)
    first = reader(tmp_path)(rgb, points)
    second = reader(tmp_path, CARD.replace("[input]", '[input]\ncolour = "bgr"'))(rgb, points)
    assert first is not None
    assert second is not None
    assert np.allclose(first.reshape(3, 256), second.reshape(3, 256)[::-1])
    assert first[0] > 0 > first[256]


def test_embeddings_have_length_one_and_do_not_depend_on_contrast(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rgb = rng.integers(0, 256, (100, 100, 3), np.uint8)
    recognise = Recogniser(recogniser(tmp_path))
    vector = recognise(rgb, landmarks(4.0, 10, 10))
    assert vector is not None
    assert np.linalg.norm(vector) == pytest.approx(1)
    assert vector.shape == (recognise.dimension,) == (24,)
    assert recognise.name == "projection"


def test_points_without_extent_have_no_embedding(tmp_path: Path) -> None:
    assert Recogniser(recogniser(tmp_path))(np.zeros((50, 50, 3), np.uint8), np.full((81, 2), 7.0)) is None


def test_five_points_are_eyes_nose_and_mouth() -> None:
    assert np.allclose(five_points(landmarks(2.0, 3, 4)), 2 * TEMPLATE + (3, 4))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("size = [16, 16]", "size = [16]", "input.size must be [width, height] in pixels, got [16]"),
        ("size = [16, 16]", "", "input.size must be [width, height] in pixels, got nothing"),
        ("mean = 127.5", "mean = [1, 2]", "input.mean must be one number or 3, got [1, 2]"),
        ("mean = 127.5", 'mean = "dark"', "input.mean must be one number or 3, got 'dark'"),
        ("mean = 127.5", 'colour = "gray"', "input.colour must be one of rgb, bgr, got 'gray'"),
        ("mean = 127.5", 'layout = "hwc"', "input.layout must be one of nchw, nhwc, got 'hwc'"),
        (
            "mean = 127.5",
            "means = 1",
            "[input] may have size, colour, layout, mean, scale, got unknown means",
        ),
        (", [10.2, 12.0]]", "]", "template.points must be five points [x, y] in pixels, got"),
        ('model = "projection.onnx"', "", "model must be a text, got nothing"),
        ('model = "projection.onnx"', 'model = ""', "model must be a text, got nothing"),
        ('name = "projection"', "input = 3", "must be a readable TOML file"),
    ],
)
def test_a_wrong_card_is_refused_by_its_key(tmp_path: Path, old: str, new: str, expected: str) -> None:
    card = tmp_path / "card.toml"
    assert old in CARD
    card.write_text(CARD.replace(old, new))
    with pytest.raises(RecogniserError) as caught:
        read_recogniser_card(card)
    assert str(caught.value).startswith(f"recogniser card {card}")
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("projection.onnx", "none.onnx", "none.onnx, got no such file"),
        ("projection.onnx", "card.toml", "card.toml must be an ONNX file"),
        (
            "size = [16, 16]",
            "size = [20, 16]",
            "describes float input (1, 3, 16, 20), got a model with",
        ),
        ('name = "projection"', 'sha256 = "00"', "expected sha256 00, got"),
    ],
)
def test_a_model_that_differs_from_its_card_is_refused(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    card = recogniser(tmp_path)
    card.write_text(CARD.replace(old, new))
    with pytest.raises(RecogniserError) as caught:
        Recogniser(card)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not MODEL.is_file(), reason="the MobileFaceNet model is not there")
@pytest.mark.skipif(not REAL.is_dir(), reason="the real clips are not there")
@pytest.mark.slow
def test_the_documented_card_tells_people_apart(tmp_path: Path) -> None:
    from guise.app.measure.privacy import template
    from guise.app.media import open_input

    text = (ROOT / "docs" / "measure.md").read_text(encoding="utf-8")
    card = tmp_path / "card.toml"
    card.write_text(text.split("```toml\n")[1].split("```")[0])
    (tmp_path / "mobilefacenet.onnx").symlink_to(MODEL)
    recognise, people = Recogniser(card), []
    for name in ("talk_r1", "talk_r2", "studio_d5"):
        points = np.load(REAL / f"{name}.landmarks.npz")["face81"][:, 0]
        with open_input(REAL / f"{name}.mp4") as source:
            vectors = [recognise(f.rgb(), points[f.index]) for f in source if f.index % 40 == 0]
        people.append(np.stack([v for v in vectors if v is not None]))
    for i, rows in enumerate(people):
        same = rows[1::2] @ template(rows[::2])
        others = [float((rows @ template(other)).max()) for j, other in enumerate(people) if j != i]
        assert same.min() > 0.6
        assert max(others) < 0.4
