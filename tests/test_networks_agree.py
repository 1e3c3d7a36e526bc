"""The networks that find and parse faces answer the same on every processor, fused by the runtime or not.

The answers held were given on a processor with AVX-512 and VNNI; one with AVX2 alone gave the same. After a network has
changed: GUISE_UPDATE_GOLDEN=1 pytest tests/test_networks_agree.py.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from guise.aam.landmarks.detector import MIDDLE_GREY
from guise.aam.onnx_model import DATA
from guise.common.arrays import F32, U8

HELD = Path(__file__).parent / "golden" / "network_answers.npz"
NETWORKS = ("detector", "face", "head", "landmarks")
TOLERANCE = 0.01  # of an output's range
STRIDE = 8  # of the cells of maps whose answers are held


def drawn_face(seed: int) -> U8:
    """A crop (128, 128, 3) of simple shapes in the places of a face, in noise: whole numbers, the same everywhere."""
    rng = np.random.default_rng(seed)
    crop = np.kron(rng.integers(40, 200, (8, 8, 3)), np.ones((16, 16, 1), np.int64)).astype(np.uint8)
    shapes = [
        ((64, 70), (40, 52), (196, 150, 128)),
        ((46, 58), (9, 4), (235, 230, 228)), ((82, 58), (9, 4), (235, 230, 228)),
        ((46, 58), (4, 4), (60, 40, 30)), ((82, 58), (4, 4), (60, 40, 30)),
        ((46, 46), (11, 2), (70, 50, 40)), ((82, 46), (11, 2), (70, 50, 40)),
        ((64, 80), (6, 3), (150, 105, 90)), ((64, 97), (15, 5), (170, 70, 75)),
    ]  # fmt: skip
    ys, xs = np.mgrid[:128, :128]
    for (x, y), (wide, high), colour in shapes:
        inside = ((xs - x) * high) ** 2 + ((ys - y) * wide) ** 2 <= (wide * high) ** 2
        crop[inside] = colour
    return np.clip(crop + rng.integers(-12, 13, crop.shape), 0, 255).astype(np.uint8)


def answers(network: str, crop: U8, *, fused: bool = True) -> dict[str, F32]:
    """Outputs of a shipped network, by name."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    if not fused:
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    session = onnxruntime.InferenceSession(
        DATA / f"{network}.onnx", options, providers=["CPUExecutionProvider"]
    )
    names = [output.name for output in session.get_outputs()]
    given = crop[None]
    if network == "detector":
        given = np.ascontiguousarray(crop.transpose(2, 0, 1)[None] - np.float32(MIDDLE_GREY))
    return dict(zip(names, session.run(names, {session.get_inputs()[0].name: given}), strict=True))


def held_part(answer: F32) -> F32:
    """Every eighth cell of maps, all of other answers."""
    return answer[..., ::STRIDE, ::STRIDE] if answer.ndim == 4 else answer


def apart(one: F32, other: F32) -> float:
    """Greatest difference, as a share of the range."""
    return float(np.abs(one - other).max() / max(float(np.ptp(one)), 1.0))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("network", ["detector", "face", "landmarks"])
def test_fused_and_plain_networks_agree(network: str, seed: int) -> None:
    crop = drawn_face(seed)
    fused, plain = answers(network, crop), answers(network, crop, fused=False)
    for name, answer in fused.items():
        assert apart(answer, plain[name]) < TOLERANCE, name


def test_networks_answer_as_on_other_processors() -> None:
    found = {
        f"{network}.{name}": held_part(answer)
        for network in NETWORKS
        for name, answer in answers(network, drawn_face(0)).items()
    }
    if os.environ.get("GUISE_UPDATE_GOLDEN"):
        np.savez_compressed(HELD, **found)
    with np.load(HELD) as held:
        assert set(held.files) == set(found)
        for name, answer in found.items():
            assert apart(held[name], answer) < TOLERANCE, name


def test_the_drawn_face_is_told_into_parts() -> None:
    """Or agreement on it would say little."""
    classes = answers("face", drawn_face(0))["parsing"][0].argmax(0)
    assert len(np.unique(classes)) >= 4
