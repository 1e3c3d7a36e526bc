"""What the learned light is trained on and how it is scored: sampling of groups, errors, and the untrained network."""

from pathlib import Path

import cv2
import numpy as np
import onnxruntime
import pytest
from numpy.testing import assert_allclose

torch = pytest.importorskip("torch")

from guise.app.drawing.passes.light import GRID  # noqa: E402
from training import swap_data  # noqa: E402
from training.light_batches import Batches, Lights, Portraits  # noqa: E402
from training.light_net import LightNet  # noqa: E402
from training.placement import Group, transferred  # noqa: E402
from training.swap_data import Cells  # noqa: E402
from training.train_light import Errors, Lit, measure  # noqa: E402

CELLS = Cells()
PEOPLE, SCENES, SIZE = 2, 2, 96
OWN = np.array([0, 1, 6, 7, 8, 9, 14, 15])  # rows of those who have their own face


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> swap_data.Samples:
    """A group of two people of one colour each: donors as they are, scenes half as bright, truths as the scenes."""
    reference = CELLS.reference
    shape = (reference.points - reference.points.mean(0)) * (0.7 * SIZE / reference.size[0]) + SIZE / 2
    colours = np.array([[200, 150, 120], [120, 80, 60]])
    pictures = [np.full((SIZE, SIZE, 3), colours[i]) for i in range(PEOPLE) for _ in range(SCENES)]
    pictures += [picture // 2 for picture in pictures] + [
        colours[i] // 2 * np.ones((SIZE, SIZE, 1)) for i in (0, 0, 1, 1)
    ]
    pictures += pictures[: PEOPLE * SCENES]
    jpegs = [
        cv2.imencode(".jpg", np.uint8(p[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
        for p in pictures
    ]
    path = Path(tmp_path_factory.mktemp("swaps")) / "group_00003.npz"
    np.savez(
        path,
        jpeg=np.frombuffer(b"".join(jpegs), np.uint8),
        length=np.array([len(jpeg) for jpeg in jpegs], np.int32),
        face81=np.repeat(shape[None].astype(np.float32), len(pictures), 0),
        hair=np.zeros((PEOPLE, SCENES, SIZE, SIZE // 8), np.uint8),
        people=np.int32(PEOPLE),
        scenes=np.int32(SCENES),
    )
    return swap_data.load([path], CELLS)


def test_every_donor_is_sampled_on_every_head_and_mirrored(samples: swap_data.Samples) -> None:
    assert len(samples.group) == 2 * PEOPLE * PEOPLE * SCENES
    assert (samples.group == 3).all()
    assert np.flatnonzero(samples.keeps_face).tolist() == OWN.tolist()
    face = samples.shown[0] > 200
    assert 500 < face.sum() < GRID[0] * GRID[1]
    assert_allclose(samples.truth[0][:, face].T, [[100, 75, 60]] * face.sum(), atol=2)
    assert_allclose(
        samples.pictures[samples.donor[SCENES], 0][:, CELLS.weight[0] > 0.9].mean(1), [120, 80, 60], atol=2
    )
    assert_allclose(
        samples.pictures[samples.own[SCENES], 0][:, CELLS.weight[0] > 0.9].mean(1), [200, 150, 120], atol=2
    )
    assert_allclose(
        samples.pictures[samples.scene[SCENES], 0][:, CELLS.weight[0] > 0.9].mean(1), [100, 75, 60], atol=2
    )


def test_faces_are_drawn_as_the_engine_draws_them_where_the_scene_is_found() -> None:
    frontal = CELLS.reference.points * 2.0 + 20
    shapes = np.tile(frontal, (PEOPLE, 3, 1, 1))
    truths = np.tile(frontal, (PEOPLE, PEOPLE, 3, 1, 1))
    scenes = shapes + np.array([7.0, -3.0])
    scenes[0, 1] = np.nan
    places = list(
        transferred(Group(shapes, scenes, shapes, scenes, truths), np.random.default_rng(0), learned=False)
    )
    assert [(p.head, p.donor, p.scene) for p in places] == [(1, 0, 0), (1, 0, 1), (1, 0, 2)]
    assert_allclose(places[0].drawn(), scenes[1, 0], atol=1)


def test_the_untrained_network_is_a_classical_light(samples: swap_data.Samples) -> None:
    batches, rows = Batches(samples, CELLS), np.arange(len(samples.group))
    untrained = measure(Lit(LightNet().eval(), CELLS), batches, rows)
    assert untrained["error"] < 3
    assert measure(lambda batch: batch.face, batches, rows)["error"] > 20


def test_errors_are_lab_distances_of_what_is_shown() -> None:
    grey, shown = torch.full((1, 3, *GRID), 120.0), torch.ones(1, *GRID)
    lighter = grey.clone()
    lighter[..., : GRID[1] // 2] = 160
    plain, smooth = Errors()(lighter, grey, shown)
    assert 5 < float(plain) < 10
    assert 5 < float(smooth) < 10
    shown[..., : GRID[1] // 2] = 0
    assert float(Errors()(lighter, grey, shown)[0]) < 0.5


def test_disturbed_batches_keep_the_truth_consistent_with_the_scene(samples: swap_data.Samples) -> None:
    lights = Lights(swap_data.light_fields(samples, CELLS))
    batch = Batches(samples, CELLS, lights).random(8, np.random.default_rng(0))
    own = (batch.truth - batch.untouched).abs().amax((1, 2, 3))
    assert (own < 1e-3).any()  # somebody with their own face, under the same camera
    assert batch.shown.min() == 0
    assert torch.isfinite(batch.skin).all()


def test_some_scenes_are_lit_otherwise_and_the_others_as_they_are(samples: swap_data.Samples) -> None:
    lights, rng = Lights(swap_data.light_fields(samples, CELLS)), np.random.default_rng(0)
    for factors, share in ((lights.on_top(400, rng), 0.45), (lights.of_enrolment(400, rng), 0.4)):
        assert factors.shape == (400, 1, 3, *GRID)
        assert factors.min() > 0
        lit = ((factors - 1).abs().amax((1, 2, 3, 4)) > 1e-6).float().mean()
        assert float(lit) == pytest.approx(share, abs=0.15)  # the lights of these scenes are even


def test_the_light_of_a_rendered_scene_is_what_it_does_to_skin(samples: swap_data.Samples) -> None:
    fields = swap_data.light_fields(samples[OWN], CELLS)
    assert fields.shape == (len(OWN), 3, *GRID)
    assert_allclose(fields[:, :, CELLS.weight[0] > 0.9], 0.5, atol=0.02)


def test_on_photographs_another_face_is_known_in_the_tone_and_light_of_the_scene(
    samples: swap_data.Samples,
) -> None:
    """These faces are of one colour each, so that in the other's tone they are the other's."""
    rows = samples.donor[[0, 1, SCENES, SCENES + 1]]
    faces, lights = samples.pictures[rows], Lights(swap_data.light_fields(samples[OWN], CELLS))
    batch = Portraits(faces, ["a", "a", "b", "b"], lights, CELLS).random(40, np.random.default_rng(1))
    skin_alone = batch.shown.sum((1, 2)) < 0.99 * batch.shown.sum((1, 2)).max()
    assert 10 < skin_alone.sum() < 40
    away = (batch.truth - batch.untouched).abs() * (batch.shown > 0.9)[:, None]
    assert away.mean() < 2  # noise
    face = batch.truth[:, :, batch.shown[skin_alone][0] > 0.9]
    assert (face.std(2) > 2).any()
    assert (face.diff(dim=2).abs().mean() < 0.5 * face.std(2).mean()).all()


def test_stored_weights_are_nearly_those_that_were_learned(tmp_path: Path) -> None:
    """In a quarter of the bytes."""
    onnx = pytest.importorskip("onnx")
    from training.stored_weights import halve, quarter

    rng = np.random.default_rng(0)
    weights = (rng.standard_normal((32, 16, 3, 3)) * rng.uniform(0.01, 10, (32, 1, 1, 1))).astype(np.float32)
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Conv", ["in", "weights"], ["out"])],
        "convolution",
        [onnx.helper.make_tensor_value_info("in", onnx.TensorProto.FLOAT, [1, 16, 9, 9])],
        [onnx.helper.make_tensor_value_info("out", onnx.TensorProto.FLOAT, [1, 32, 7, 7])],
        [onnx.numpy_helper.from_array(weights, "weights")],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    picture, found, sizes = rng.standard_normal((1, 16, 9, 9)).astype(np.float32), [], []
    for change in (lambda path: None, halve, quarter):
        path = tmp_path / "network.onnx"
        onnx.save(model, path)
        change(path)
        sizes.append(path.stat().st_size)
        (out,) = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"]).run(
            None, {"in": picture}
        )
        found.append(out)
    spread = found[0].std((0, 2, 3), keepdims=True)
    assert (np.abs(found[1] - found[0]) < 0.01 * spread).all()
    assert (np.abs(found[2] - found[0]) < 0.05 * spread).all()
    assert sizes[1] < 0.6 * sizes[0]
    assert sizes[2] < 0.35 * sizes[0]
