"""The network that sees a face, its losses and its course; skipped without PyTorch."""

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is for training only")
onnx = pytest.importorskip("onnx", reason="ONNX is for training only")

from training.all import Plan  # noqa: E402
from training.augment import Props, objects_alone  # noqa: E402
from training.data import Labelled  # noqa: E402
from training.dequantise import load_shipped, module_name  # noqa: E402
from training.face_logit import fitted  # noqa: E402
from training.face_net import MAPS, FaceNet  # noqa: E402
from training.measure import answers_of, answers_of_file  # noqa: E402
from training.parsing_labels import CLASSES, OCCLUDER, SKIN  # noqa: E402
from training.train_face import (  # noqa: E402
    EXACT,
    NONE,
    POSSIBLE,
    SHIPPED,
    Course,
    loss_of,
    outlines,
    parsing_loss,
)

torch.set_flush_denormal(True)  # far weights of heat maps are tiny
RNG = np.random.default_rng(0)


def small() -> FaceNet:
    torch.manual_seed(0)
    return FaceNet(width=4, blocks=(0, 0, 0), head=8, decoder=8)


def batch(count: int = 4) -> tuple[torch.Tensor, ...]:
    """Grey crops with a bright dot: every point and iris lies there; the left half is skin."""
    crops, places = np.full((count, 128, 128, 3), 60, np.uint8), RNG.uniform(40, 90, (count, 2))
    for crop, (x, y) in zip(crops, places, strict=True):
        crop[int(y) - 2 : int(y) + 3, int(x) - 2 : int(x) + 3] = 255
    maps = np.zeros((count, len(CLASSES), MAPS, MAPS), np.uint8)
    maps[:, SKIN, :, : MAPS // 2] = maps[:, 0, :, MAPS // 2 :] = 255
    iris = np.concatenate([places[:, None].repeat(2, 1), np.full((count, 2, 1), 4.0)], 2)
    arrays = (
        crops, places[:, None].repeat(81, 1).astype(np.float32), np.ones(count, np.float32),
        iris.astype(np.float32), np.ones((count, 2), np.float32), maps, np.full(count, EXACT, np.uint8),
    )  # fmt: skip
    return tuple(torch.from_numpy(a) for a in arrays)


def test_the_network_learns_points_irises_and_parsing_of_a_dot() -> None:
    net, given = small(), batch(3)
    optimiser = torch.optim.Adam(net.parameters(), 3e-3)
    rows = []
    for _ in range(30):
        loss, figures = loss_of(net, given)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        rows.append(figures)
    for name in ("points_px", "iris", "parsing"):
        assert rows[-1][name] < 0.8 * rows[0][name]
    points, sigma, face, iris, parsing = net.eval()(given[0])
    assert points.shape == (3, 81, 2)
    assert (sigma > 0).all()
    assert face.shape == (3,)
    assert iris.shape == (3, 2, 4)
    assert (iris[..., 2:] > 0).all()
    assert parsing.shape == (3, len(CLASSES), MAPS, MAPS)
    torch.testing.assert_close(parsing.sum(1), torch.ones(3, MAPS, MAPS))


def test_parsing_costs_nothing_where_nothing_is_known_and_less_where_it_is_right() -> None:
    maps = batch(2)[5]
    right = maps.float() / 255 * 20
    assert parsing_loss(right, maps, torch.full((2,), NONE)) == 0
    for kind in (EXACT, POSSIBLE):
        known = torch.full((2,), kind)
        assert parsing_loss(right, maps, known) < 0.5 * parsing_loss(-right, maps, known)
    anything = torch.full_like(maps, 255)
    assert parsing_loss(right, anything, torch.full((2,), POSSIBLE)) == pytest.approx(0, abs=1e-5)


def test_shipped_weights_come_back_from_8_bits() -> None:
    rng = np.random.default_rng(1)
    crops = rng.integers(0, 256, (6, 16, 16, 3)).astype(np.uint8).repeat(8, 1).repeat(8, 2)
    net = FaceNet()
    load_shipped(net, SHIPPED, crops)
    mine, theirs = answers_of(net)(crops), answers_of_file(SHIPPED)(crops)
    np.testing.assert_allclose(mine.points, theirs.points, atol=4)
    assert np.abs(mine.points - theirs.points).mean() < 1
    assert np.corrcoef(mine.face, theirs.face)[0, 1] > 0.9


def test_the_parser_comes_back_without_points_and_trains_as_it_is() -> None:
    crops = RNG.integers(0, 256, (12, 16, 16, 3)).astype(np.uint8).repeat(8, 1).repeat(8, 2)
    net, file = FaceNet(), SHIPPED.with_name("face.onnx")
    guess = net.guess.weight.detach().clone()
    load_shipped(net, file, crops)
    theirs = answers_of_file(file)(crops)
    for training in (False, True):  # with the statistics of the crops, and with those of the batch
        iris, parsing = net.train(training)(torch.from_numpy(crops))[3:]
        assert np.abs(parsing.detach().numpy() - theirs.parsing).mean() < 0.02
        assert np.abs(iris.detach().numpy() - theirs.iris).mean() < 2
    torch.testing.assert_close(net.guess.weight, guess)


def test_outlines_of_occluders_count_more_and_nothing_else_does() -> None:
    share = torch.zeros(1, MAPS, MAPS)
    share[0, 20:50, 30:34] = 1  # a finger
    near = outlines(share)
    assert (near[0, 25:45, 29:35] == 1).all()
    assert near[0, :, :25].sum() == near[0, :, 40:].sum() == 0
    share[0, 20:50, 10:60] = 1  # a palm
    assert outlines(share)[0, 30:40, 30:40].sum() == 0
    maps, logits = torch.zeros(1, len(CLASSES), MAPS, MAPS, dtype=torch.uint8), None
    maps[0, SKIN] = 255
    maps[0, :, 20:50, 30:34], maps[0, OCCLUDER, 20:50, 30:34] = 0, 255
    costs = []
    for column in (35, 60):  # one row of cells wrong, beside the finger or far away
        logits = 20 * maps.float() / 255
        logits[0, [SKIN, OCCLUDER], 20:50, column] = torch.tensor([[0.0], [20.0]])
        costs.append(float(parsing_loss(logits, maps, torch.full((1,), EXACT))))
    assert costs[0] > 1.5 * costs[1]


def test_names_of_modules_are_read_from_the_graph() -> None:
    assert module_name("/fine/fine.2/first/first.0/Conv") == "fine.2.first.0"
    assert module_name("/from_coarse/Conv") == "from_coarse"
    assert module_name("/squeeze/squeeze.0/Conv") == "squeeze.0"


def test_the_rate_rises_holds_and_falls_to_nothing() -> None:
    course = Course(steps=1000, rate=1e-3, warm=100, decay=0.3)
    factors = [course.at(k, 0) for k in range(1001)]
    assert factors[0] == pytest.approx(0.01)
    assert factors[100] == factors[600] == 1
    assert 0 < factors[850] < 1
    assert factors[1000] == pytest.approx(0, abs=1e-9)


def test_a_course_with_a_limit_of_time_ends_by_it() -> None:
    course = Course(steps=1_000_000, rate=1e-3, seconds=60, decay=0.3)
    assert course.at(500, 30) == 1
    assert 0 < course.at(900, 50) < 1
    assert course.at(1000, 60) == pytest.approx(0, abs=1e-9)
    assert course.passed(1000, 61) == 1


def test_the_plan_makes_everything_that_ships(tmp_path: Path) -> None:
    plan = Plan(tmp_path / "people", tmp_path / "data", tmp_path / "work", processes=3, people=70)
    steps = list(plan.tasks())
    assert not any(step.done() for step in steps)
    renders = steps[0].commands
    first = [int(c[c.index("--first") + 1]) for c in renders]
    count = [int(c[c.index("--people") + 1]) for c in renders]
    assert sum(count) == 70
    assert first == [0, 30, 60]
    made = {step.output for step in steps}
    assert {plan.work / "recognition.npz", plan.work / "alignment.json"} <= made
    for step in steps:
        for command in step.commands:
            assert (Path(__file__).parents[1] / "training" / f"{command[0]}.py").exists()


def test_a_small_plan_has_the_same_steps_with_less_to_do(tmp_path: Path) -> None:
    whole, small = (
        list(Plan(tmp_path, tmp_path, tmp_path, processes=1, scale=scale).tasks()) for scale in (1.0, 0.01)
    )
    assert [task.name for task in small] == [task.name for task in whole]
    for sized in ("--steps", "--people", "--count"):
        sizes = [
            [int(c[c.index(sized) + 1]) for task in plan for c in task.commands if sized in c]
            for plan in (whole, small)
        ]
        assert all(10 <= less <= 0.2 * more or less == 40 for more, less in zip(*sizes, strict=True))


def test_the_logit_is_fitted_to_what_is_wanted() -> None:
    rng = np.random.default_rng(0)
    features = rng.normal(0, 1, (4000, 6)).astype(np.float32)
    wanted = features @ np.arange(6) - 3
    weights = fitted(features, wanted)
    np.testing.assert_allclose(features @ weights[:-1] + weights[-1], wanted, atol=0.2)


def test_objects_alone_hide_a_background_and_show_no_face() -> None:
    size, points = 176, np.random.default_rng(1).uniform(40, 130, (81, 2)).astype(np.float32)
    face = Labelled(np.full((size, size, 3), (255, 0, 0), np.uint8), points, np.ones(81, bool))
    props = Props(np.full((1, size, size, 3), 90, np.uint8))
    for seed in range(8):
        crop = objects_alone(np.random.default_rng(seed), face, props).astype(int)
        assert (np.abs(crop - np.median(crop, axis=(0, 1))).max(2) > 20).mean() > 0.01
        assert (crop[..., 0] - crop[..., 1:].max(2) > 150).mean() < 0.01
