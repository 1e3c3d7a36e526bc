"""The landmarker's branches are taken out of its file and put back; skipped without ONNX."""

from pathlib import Path

import numpy as np
import pytest
from test_networks_agree import drawn_face

onnx = pytest.importorskip("onnx", reason="ONNX is for training only")

import onnxruntime  # noqa: E402

from guise.aam.onnx_model import DATA  # noqa: E402
from training.branches import branch, joined  # noqa: E402


def test_branches_come_off_and_on_and_the_answers_stay(tmp_path: Path) -> None:
    shipped, plain, again = DATA / "landmarks.onnx", tmp_path / "plain.onnx", tmp_path / "again.onnx"
    whole = joined(onnx.load(shipped))
    assert [node.name for node in whole.graph.node if node.op_type == "If"] == ["face"]
    for path in (plain, again):
        onnx.save(whole, path)
    branch(again)
    answers = []
    for path in (shipped, plain, again):
        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        answers.append(session.run(["points", "sigma", "face"], {"crop": drawn_face(0)[None]}))
    for found in answers[1:]:
        for one, other in zip(answers[0], found, strict=True):
            np.testing.assert_allclose(other, one, atol=1e-4)
