"""What tells faces from other things is trained beside a network that stays as it is; skipped without PyTorch."""

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is for training only")
onnx = pytest.importorskip("onnx", reason="ONNX is for training only")

import onnxruntime  # noqa: E402

from guise.common.arrays import U8  # noqa: E402
from training import face_head  # noqa: E402
from training.augment import Props  # noqa: E402
from training.face_head import GOAL, LOWERED, SHIPPED, Crops, Features, Head, graft, loss_of  # noqa: E402


def answers(path: Path, crop: U8) -> list[np.ndarray]:
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    return [np.asarray(one) for one in session.run(["points", "sigma", "face"], {"crop": crop[None]})]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_head_changes_the_logit_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(0)
    head = Head()
    torch.nn.init.normal_(head.last[2].weight)
    graft(head, SHIPPED, tmp_path / "landmarks.onnx")
    monkeypatch.setattr(face_head, "CROPS", 2)
    crops = [
        np.random.default_rng(seed).integers(0, 255, (128, 128, 3)).astype(np.uint8) for seed in range(2)
    ]
    made = Crops(SHIPPED, (), Props(np.zeros((0, 8, 8, 3), np.uint8)))  # type: ignore[arg-type]
    monkeypatch.setattr(made, "face", lambda rng: (crops[0], GOAL.plain))
    monkeypatch.setattr(made, "other", lambda rng: crops[1])
    shard = made.make(np.random.default_rng(0))
    told = head(*Features(SHIPPED).of(shard, slice(None))).detach().numpy() - LOWERED
    for row, is_face in enumerate(shard[6]):
        crop = crops[0 if is_face else 1]
        before, after = answers(SHIPPED, crop), answers(tmp_path / "landmarks.onnx", crop)
        np.testing.assert_array_equal(after[0], before[0])
        np.testing.assert_array_equal(after[1], before[1])
        assert after[2][0] == pytest.approx(told[row], abs=0.05)  # large weights are stored in half precision
        assert shard[5][row] == (
            max(shard[0][row], GOAL.plain) if is_face else min(shard[0][row], GOAL.other)
        )


def test_a_logit_beyond_what_is_asked_for_costs_nothing() -> None:
    asked, is_face = torch.tensor([2.0, -3.0]), torch.tensor([1.0, 0.0])
    assert loss_of(torch.tensor([5.0, -9.0]), asked, is_face) == 0
    assert loss_of(torch.tensor([1.0, -9.0]), asked, is_face) > 0
    assert loss_of(torch.tensor([5.0, 0.0]), asked, is_face) > 0
