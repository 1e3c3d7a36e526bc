"""ONNX landmarkers: cards, crops and bad models.

The small models are written here, byte by byte: out = flatten(input) @ weights + bias.
"""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from guise.aam.landmarks import (
    BoxFit,
    CenterfaceDetector,
    Face,
    LandmarkError,
    OnnxLandmarker,
    open_detector,
    open_landmarker,
    read_card,
    register_landmarker,
)
from guise.aam.landmarks.crops import crop_to_picture
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER, mean_geometry
from guise.aam.onnx_model import DATA, ShippedNetwork
from guise.aam.onnx_weights import without_tiny_weights

SIZE = 24


def varint(value: int) -> bytes:
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def field(number: int, value: int | bytes | str) -> bytes:
    """One protobuf field."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def tensor(name: str, array: np.ndarray) -> bytes:
    dims = b"".join(field(1, size) for size in array.shape)
    return dims + field(2, 1) + field(8, name) + field(9, array.astype("<f4").tobytes())


def value_info(name: str, shape: tuple[int, ...]) -> bytes:
    dims = b"".join(field(1, field(1, size)) for size in shape)
    return field(1, name) + field(2, field(1, field(1, 1) + field(2, dims)))


def node(kind: str, inputs: list[str], output: str) -> bytes:
    return b"".join(field(1, name) for name in inputs) + field(2, output) + field(4, kind)


def linear_model(shape: tuple[int, ...], weights: np.ndarray, bias: np.ndarray) -> bytes:
    graph = b"".join(
        [
            field(1, node("Flatten", ["input"], "flat")),
            field(1, node("MatMul", ["flat", "weights"], "product")),
            field(1, node("Add", ["product", "bias"], "points")),
            field(2, "linear"),
            field(5, tensor("weights", weights)),
            field(5, tensor("bias", bias)),
            field(11, value_info("input", shape)),
            field(12, value_info("points", (1, len(bias)))),
        ]
    )
    return field(1, 8) + field(7, graph) + field(8, field(2, 13))


def mean_face() -> np.ndarray:
    """Mean face in fractions of its own square crop, (81, 2)."""
    mean = mean_geometry().mean
    points = np.stack([mean.real, mean.imag], axis=-1)
    side = np.ptp(points, axis=0).max()
    return np.asarray((points - (points.max(axis=0) + points.min(axis=0)) / 2) / side / 1.1 + 0.5)


CARD = """
model = "{model}"
scheme = "face81"
[input]
size = [24, 24]
{input}
[crop]
enlarge = 1.1
{crop}
[output]
{output}
"""


def write_card(
    folder: Path,
    weights: np.ndarray | None = None,
    bias: np.ndarray | None = None,
    shape: tuple[int, ...] = (1, 3, SIZE, SIZE),
    **parts: str,
) -> Path:
    """Card and model in a folder; by default the mean face whatever the picture is."""
    bias = mean_face().ravel() if bias is None else bias
    weights = np.zeros((int(np.prod(shape)), len(bias))) if weights is None else weights
    (folder / "model.onnx").write_bytes(linear_model(shape, weights, bias))
    values = {"model": "model.onnx", "input": "", "crop": "", "output": "", **parts}
    (folder / "card.toml").write_text(CARD.format(**values))
    return folder / "card.toml"


class FixedBoxes:
    """A detector that finds the same boxes in every picture."""

    name = "fixed"
    fit = BoxFit()

    def __init__(self, *boxes: tuple[float, float, float, float]) -> None:
        self.boxes = np.array(boxes, np.float32).reshape(-1, 4)

    def detect(self, image: np.ndarray) -> np.ndarray:
        return self.boxes

    def detect_scored(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.boxes, np.full(len(self.boxes), 0.9, np.float32)


PICTURE = np.full((200, 300, 3), 120, np.uint8)


def test_mean_face_lands_in_the_box(tmp_path: Path) -> None:
    landmarker = OnnxLandmarker(write_card(tmp_path), FixedBoxes((50, 40, 150, 140)))
    (face,) = landmarker.detect(PICTURE)
    assert face.confidence == pytest.approx(0.9)
    np.testing.assert_allclose((face.box[:2] + face.box[2:]) / 2, [100, 90], atol=0.01)
    assert np.ptp(face.points, axis=0).max() == pytest.approx(100, abs=0.01)
    again = landmarker.refine(PICTURE, face)
    assert again is not None
    np.testing.assert_allclose(again.points, face.points, atol=0.01)
    assert landmarker.name == "card@fixed"


def test_faces_come_largest_first_and_once(tmp_path: Path) -> None:
    boxes = FixedBoxes((10, 10, 60, 60), (100, 20, 220, 140), (102, 22, 222, 142))
    faces = OnnxLandmarker(write_card(tmp_path), boxes).detect(PICTURE)
    assert len(faces) == 2
    assert faces[0].area > faces[1].area


def test_face_beyond_the_picture_is_lost(tmp_path: Path) -> None:
    landmarker = OnnxLandmarker(write_card(tmp_path), FixedBoxes((260, 40, 460, 240)))
    assert landmarker.detect(PICTURE) == []
    outside = Face.around(mean_face() * 100 + (280, 50), 1.0)
    assert landmarker.refine(PICTURE, outside) is None


def test_points_unlike_a_face_are_dropped(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).random(162)
    assert (
        OnnxLandmarker(write_card(tmp_path, bias=noise), FixedBoxes((50, 40, 150, 140))).detect(PICTURE) == []
    )
    nothing = np.full(162, np.nan)
    assert (
        OnnxLandmarker(write_card(tmp_path, bias=nothing), FixedBoxes((5, 4, 99, 98))).detect(PICTURE) == []
    )


def test_points_that_do_not_settle_are_dropped(tmp_path: Path) -> None:
    drifting = (mean_face() + np.array([0.05, 0])).ravel()
    landmarker = OnnxLandmarker(write_card(tmp_path, bias=drifting), FixedBoxes((50, 40, 150, 140)))
    assert landmarker.detect(PICTURE) == []
    assert landmarker.refine(PICTURE, Face.around(mean_face() * 100 + (50, 50), 1.0)) is None


@pytest.mark.parametrize("order", ["interleaved", "split"])
@pytest.mark.parametrize("unit", ["fraction", "pixels"])
def test_output_layouts_mean_the_same(tmp_path: Path, order: str, unit: str) -> None:
    points = mean_face() if unit == "fraction" else mean_face() * SIZE - 0.5
    bias = points.ravel() if order == "interleaved" else points.T.ravel()
    card = write_card(tmp_path, bias=bias, output=f'order = "{order}"\nunit = "{unit}"\nname = "points"')
    found = OnnxLandmarker(card, FixedBoxes()).points_in(PICTURE, np.array([50, 40, 150, 140]))
    np.testing.assert_allclose(found, mean_face() * 110 + (45, 35), atol=1e-4)


@pytest.mark.parametrize(
    ("colour", "expected"), [("rgb", (10, 20, 30)), ("bgr", (30, 20, 10)), ("gray", (18,))]
)
@pytest.mark.parametrize("layout", ["nchw", "nhwc"])
def test_model_is_fed_as_the_card_says(
    tmp_path: Path, colour: str, expected: tuple[int, ...], layout: str
) -> None:
    """The weights read channel c, row 3, column 5 into the first numbers."""
    channels = len(expected)
    shape = (1, channels, SIZE, SIZE) if layout == "nchw" else (1, SIZE, SIZE, channels)
    weights = np.zeros((*shape[1:], 162))
    for channel in range(channels):
        weights[(channel, 3, 5) if layout == "nchw" else (3, 5, channel)][channel] = 1
    means = [1.0, 2.0, 3.0][:channels]
    told = f'colour = "{colour}"\nlayout = "{layout}"\nmean = {means}\nscale = 0.5'
    card = write_card(
        tmp_path, weights.reshape(-1, 162), np.zeros(162), shape, input=told, output='unit = "pixels"'
    )
    crop = np.zeros((SIZE, SIZE, 3), np.uint8)
    crop[3, 5] = 10, 20, 30
    found = OnnxLandmarker(card, FixedBoxes())._predict(crop).ravel()[:channels]
    np.testing.assert_allclose(found, [(v - m) / 2 for v, m in zip(expected, means, strict=True)], atol=0.3)


def test_crop_keeps_pixel_centres(tmp_path: Path) -> None:
    """A model that finds the centre of a blob gives its place in the picture, not off by half a pixel."""
    x, y = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    places = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    blob_sum = 200 * 2 * np.pi * 2.0**2
    weights = np.broadcast_to(places / blob_sum, (SIZE * SIZE, 81, 2)).reshape(-1, 162)
    told = 'colour = "gray"\nscale = 1'
    card = write_card(
        tmp_path, weights, np.zeros(162), (1, 1, SIZE, SIZE), input=told, output='unit = "pixels"'
    )
    rows, columns = np.mgrid[:200, :300]
    where = np.array([131.3, 88.6])
    blob = 200 * np.exp(-((columns - where[0]) ** 2 + (rows - where[1]) ** 2) / (2 * 2.0**2))
    picture = np.repeat(np.round(blob).astype(np.uint8)[..., None], 3, axis=2)
    half = SIZE / 1.1 / 2
    for corner in ((120.0, 80.0), (121.37, 77.71)):
        centre = np.array(corner) + half
        box = np.concatenate([centre - half, centre + half])
        found = OnnxLandmarker(card, FixedBoxes()).points_in(picture, box)
        np.testing.assert_allclose(found[0], where, atol=0.15)


def test_crop_corners_are_the_squares_corners() -> None:
    inverse = crop_to_picture(np.array([20.0, 40.0]), 60.0, 0.0, (12, 24))
    corners = np.array([[-0.5, -0.5], [11.5, 23.5]]) @ inverse[:, :2].T + inverse[:, 2]
    np.testing.assert_allclose(corners, [[-10, 10], [50, 70]])


def test_upright_crop_turns_with_the_face(tmp_path: Path) -> None:
    landmarker = OnnxLandmarker(write_card(tmp_path, crop="upright = true"), FixedBoxes())
    turn = np.deg2rad(30)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    rolled = (mean_face() - 0.5) @ rotation.T * 90 + (150, 100)
    found = landmarker._once(PICTURE, rolled)
    eyes = found[LEFT_EYE_OUTER] - found[RIGHT_EYE_OUTER]
    assert np.rad2deg(np.arctan2(eyes[1], eyes[0])) == pytest.approx(30, abs=0.1)


def test_card_may_adjust_the_detectors_box(tmp_path: Path) -> None:
    card = write_card(tmp_path)
    card.write_text(card.read_text() + "\n[start]\npasses = 1\n[box.fixed]\nscale = 0.5\nshift = [0.25, 0]\n")
    (face,) = OnnxLandmarker(card, FixedBoxes((50, 40, 150, 140))).detect(PICTURE)
    np.testing.assert_allclose((face.box[:2] + face.box[2:]) / 2, [125, 90], atol=0.01)
    assert np.ptp(face.points, axis=0).max() == pytest.approx(50, abs=0.01)


def test_card_says_where_the_model_comes_from(tmp_path: Path) -> None:
    card = write_card(tmp_path)
    digest = hashlib.sha256((tmp_path / "model.onnx").read_bytes()).hexdigest()
    told = f'name = "mine"\nlicence = "CC0-1.0"\nsource = "here"\nsha256 = "{digest.upper()}"\n'
    card.write_text(told + card.read_text())
    read = OnnxLandmarker(card, FixedBoxes()).card
    assert (read.name, read.licence, read.source) == ("mine", "CC0-1.0", "here")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('scheme = "face81"', ""), "scheme must be a text, got nothing"),
        (('scheme = "face81"', 'scheme = "wflw"'), "one of face81, ibug68.*, got 'wflw'"),
        (('model = "model.onnx"', ""), "model must be a text, got nothing"),
        (('model = "model.onnx"', "model = 3"), "model must be a text, got 3"),
        (
            ('model = "model.onnx"', 'model = "none.onnx"'),
            "expected its model at .*none.onnx, got no such file",
        ),
        (("[24, 24]", "[24]"), r"input.size must be \[width, height\] in pixels, got \[24\]"),
        (("[24, 24]", "[24, 0]"), r"got \[24, 0\]"),
        (("[24, 24]", "[32, 24]"), r"describes float input \(1, 3, 24, 32\), got a model with"),
        (("size = [24, 24]", ""), "input.size must be .*, got nothing"),
        (("[crop]", 'colour = "yuv"\n[crop]'), "input.colour must be one of rgb, bgr, gray, got 'yuv'"),
        (("[crop]", 'layout = "nhwc"\n[crop]'), r"describes float input \(1, 24, 24, 3\)"),
        (("[crop]", "mean = [1, 2]\n[crop]"), r"input.mean must be one number or 3, got \[1, 2\]"),
        (("[crop]", "scale = nan\n[crop]"), "input.scale must be one number or 3, got nan"),
        (("[crop]", "size_ = 3\n[crop]"), r"\[input\] may have size, .* got unknown size_"),
        (("enlarge = 1.1", "enlarge = 0"), "crop.enlarge must be a number above 0, got 0"),
        (("enlarge = 1.1", "upright = 1"), "crop.upright must be true or false, got 1"),
        (("[output]", '[output]\nname = "heat"'), "output.name must be one of points, got heat"),
        (
            ("[output]", '[output]\nunit = "metres"'),
            "output.unit must be one of fraction, pixels, got 'metres'",
        ),
        (
            ("[output]", "[start]\npasses = 0\n[output]"),
            "start.passes must be a whole number from 1 to 20, got 0",
        ),
        (("[output]", "[box]\nlbp = 3\n[output]"), "box.lbp must be a table with scale and shift, got 3"),
        (("[output]", "[box.lbp]\nscale = -1\n[output]"), "box.lbp.scale must be a number above 0, got -1"),
        (("[output]", "[box.lbp]\nshift = [1]\n[output]"), r"box.lbp.shift must be \[x, y\], got \[1\]"),
        (
            ('scheme = "face81"', 'scheme = "face81"\nsha256 = "12"'),
            "expected sha256 12, got .* another version",
        ),
        (
            ('scheme = "face81"', 'scheme = "ibug68"'),
            r"put out 136 numbers for scheme ibug68, got \(1, 162\)",
        ),
        (
            ('scheme = "face81"', 'scheme = "face81"\ncolour = 1'),
            "the top level may have .* got unknown colour",
        ),
        (('scheme = "face81"', "scheme = "), "must be a readable TOML file, got: "),
    ],
)
def test_bad_cards(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    card = write_card(tmp_path)
    text = card.read_text()
    assert change[0] in text
    card.write_text(text.replace(*change))
    with pytest.raises(LandmarkError, match=message) as caught:
        OnnxLandmarker(card, FixedBoxes())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"garbage", b"\x08\x08", "cut"])
def test_bad_models(tmp_path: Path, content: bytes | str) -> None:
    card = write_card(tmp_path)
    model = tmp_path / "model.onnx"
    model.write_bytes(model.read_bytes()[:-200] if isinstance(content, str) else content)
    with pytest.raises(LandmarkError, match=r"model\.onnx must be an ONNX file, got: ") as caught:
        OnnxLandmarker(card, FixedBoxes())
    assert "\n" not in str(caught.value)


def test_bad_card_files(tmp_path: Path) -> None:
    with pytest.raises(LandmarkError, match=r"expected at .*none.toml, got no such file"):
        read_card(tmp_path / "none.toml")
    with pytest.raises(LandmarkError, match="must be a readable TOML file"):
        read_card(tmp_path)
    (tmp_path / "bin.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(LandmarkError, match="must be a readable TOML file"):
        read_card(tmp_path / "bin.toml")


def test_tiny_weights_become_zero_and_nothing_else_changes() -> None:
    weights = np.array([[1e-40, -1e-31, 2e-30, -3.0]], np.float32)
    before = linear_model((1, 1, 1, 1), weights, np.zeros(4))
    flushed = np.array([[0, 0, 2e-30, -3.0]], np.float32)
    assert without_tiny_weights(before) == linear_model((1, 1, 1, 1), flushed, np.zeros(4))


@pytest.mark.parametrize("seed", range(20))
def test_tiny_weights_of_damaged_files_do_not_raise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    content = bytearray(linear_model((1, 1, 2, 2), np.ones((4, 4)), np.zeros(4)))
    for _ in range(5):
        content[rng.integers(len(content))] = rng.integers(256)
    assert len(without_tiny_weights(bytes(content))) == len(content)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("magic", r"landmarker must be one of .*CARD.toml\[@DETECTOR\].*; got 'magic'"),
        ("", "landmarker must be one of"),
        (
            "card.toml@hog",
            "one of builtin, lbp, yunet:MODEL.onnx, centerface:MODEL.onnx; got 'hog'",
        ),
        ("card.toml@lbp:3", "face detector lbp takes no argument, got '3'"),
        ("card.toml@yunet", "face detector yunet needs its model"),
        ("card.toml@yunet:none.onnx", "expected at none.onnx, got no such file"),
        ("none.toml@lbp", "expected at none.toml, got no such file"),
        ("onnx:none.card", "expected at none.card, got no such file"),
    ],
)
def test_bad_specs(spec: str, message: str) -> None:
    with pytest.raises(LandmarkError, match=message):
        open_landmarker(spec)


def test_specs_open_cards_also_in_odd_folders(tmp_path: Path) -> None:
    folder = tmp_path / "a@b" / "c@lbp"
    folder.mkdir(parents=True)
    card = write_card(folder)
    for spec in (f"{card}", f"{card}@lbp", f"onnx:{card}@lbp"):
        assert open_landmarker(spec).name == "card@lbp"


def test_another_kind_of_landmarker_can_be_registered(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from guise.aam.landmarks import registry

    monkeypatch.setattr(registry, "_LANDMARKERS", dict(registry._LANDMARKERS))
    made = OnnxLandmarker(write_card(tmp_path), FixedBoxes())
    asked: list[tuple[str, str | None]] = []
    register_landmarker(
        "builtin", "builtin", lambda arg, box: (asked.append((arg, box and box.name)), made)[1]
    )
    assert open_landmarker("builtin") is made
    assert open_landmarker("builtin:small@lbp") is made
    assert asked == [("", None), ("small", "lbp")]


def test_shipped_networks_hold_no_tiny_weights() -> None:
    networks = sorted(DATA.glob("*.onnx"))
    assert len(networks) == 5
    for network in networks:
        content = network.read_bytes()
        assert without_tiny_weights(content) == content, network.name


def test_a_network_that_cannot_be_opened_says_so_when_it_is_used() -> None:
    network = ShippedNetwork("no such network.onnx")
    with pytest.raises(Exception, match=r"no such network\.onnx"):
        network.run(None, {})


def strided(output: str, weights: np.ndarray, bias: np.ndarray) -> list[bytes]:
    """Fields of a graph: a convolution 4 x 4 with stride 4, and its output."""
    strides = field(1, "strides") + field(8, 4) + field(8, 4) + field(20, 7)
    convolution = node("Conv", ["input", f"{output} weights", f"{output} bias"], output) + field(5, strides)
    tensors = (tensor(f"{output} weights", weights), tensor(f"{output} bias", bias))
    shape = value_info(output, (1, len(bias), 8, 8))
    return [field(1, convolution), *(field(5, one) for one in tensors), field(12, shape)]


def centerface(folder: Path) -> Path:
    """A network with CenterFace's outputs: red cells are centres of faces 32 pixels wide and 40 high."""
    red = np.zeros((1, 3, 4, 4))
    red[0, 0] = 1 / (16 * 255)
    blank = np.zeros((10, 3, 4, 4))
    size, off = np.log([10, 8]), np.array([0.25, -0.25])
    kinds = ((red, np.zeros(1)), (blank[:2], size), (blank[:2], off), (blank, np.zeros(10)))
    parts = [part for k, kind in enumerate(kinds) for part in strided(f"map {k}", *kind)]
    graph = b"".join([*parts, field(2, "centerface"), field(11, value_info("input", (1, 3, 32, 32)))])
    path = folder / "centerface.onnx"
    path.write_bytes(field(1, 8) + field(7, graph) + field(8, field(2, 13)))
    return path


def test_centerface_is_decoded(tmp_path: Path) -> None:
    """At full size and half, of column 30 and row 10 of its cells, a quarter of a cell down and to the left."""
    rgb = np.zeros((90, 170, 3), np.uint8)
    rgb[40:44, 120:124, 0], rgb[20:24, 20:24, 2] = 255, 255  # blue is none
    model = centerface(tmp_path)
    boxes, scores = CenterfaceDetector(model, smallest=16).detect_scored(rgb)
    np.testing.assert_allclose(
        boxes, [[121 - 16 - 0.5, 43 - 20 - 0.5, 121 + 16 - 0.5, 43 + 20 - 0.5]], atol=0.01
    )
    np.testing.assert_allclose(scores, [1], atol=1e-3)
    larger = CenterfaceDetector(model, smallest=32).detect(rgb.repeat(2, 0).repeat(2, 1))
    np.testing.assert_allclose(larger, boxes * 2 + 0.5, atol=0.01)
    assert open_detector(f"centerface:{model}").name == "centerface"


def test_another_network_is_not_centerface(tmp_path: Path) -> None:
    with pytest.raises(LandmarkError, match=r"CenterFace model expected at .*none.onnx, got no such file"):
        CenterfaceDetector(tmp_path / "none.onnx")
    (tmp_path / "bad.onnx").write_bytes(b"garbage")
    for other in (tmp_path / "bad.onnx", DATA / "detector.onnx"):
        with pytest.raises(LandmarkError, match=r"expected centerface\.onnx, got another file"):
            CenterfaceDetector(other)
    with pytest.raises(LandmarkError, match="face detector centerface needs its model"):
        open_detector("centerface")
