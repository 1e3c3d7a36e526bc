"""From trained weights to what ships: the smallest ONNX that errs no more, the calibration, the model card.

    python -m training.finish_landmarks --run OUT --parts PARTS --real DATA [--ship]

OUT is what `train_landmarks.py` wrote. Compares `landmarks.onnx` with a half-precision and an 8-bit variant (error on
rendered people and real pictures held out, milliseconds in the same run), fits the calibration on samples of the held
out people, and writes `landmarks.json` and `landmarks.md` beside it; with --ship everything goes to aam/data.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
from scipy.optimize import minimize

from guise.aam.landmarks import interocular
from guise.common.arrays import F32, F64, U8
from training.augment import negative, sample
from training.crops import plain_crops
from training.data import Pictures, load_parts, load_real
from training.train_landmarks import apply, make_backgrounds

DATA = Path(__file__).parents[1] / "aam" / "data"
GOOD = 0.05  # of the inter-ocular distance: the mean error that the confidence speaks of
BIG = 256  # values in a tensor above which it is stored in half precision
LARGEST_LOSS = 1.02  # a variant may err that much more, as a factor

Crops = tuple[U8, F32]


def half_precision(model: onnx.ModelProto) -> onnx.ModelProto:
    """The same graph with its large weights stored as float16, widened when the session is made."""
    smaller = onnx.ModelProto()
    smaller.CopyFrom(model)
    widen = []
    for tensor in smaller.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if tensor.data_type == TensorProto.FLOAT and values.size > BIG:
            name = tensor.name
            tensor.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
            widen.append(helper.make_node("Cast", [f"{name}_half"], [name], to=TensorProto.FLOAT))
    nodes = [*widen, *smaller.graph.node]
    del smaller.graph.node[:]
    smaller.graph.node.extend(nodes)
    onnx.checker.check_model(smaller)
    return smaller


class _Feed(CalibrationDataReader):  # type: ignore[misc]
    def __init__(self, crops: U8) -> None:
        self._rows = iter(crops)

    def get_next(self) -> dict[str, U8] | None:
        row = next(self._rows, None)
        return None if row is None else {"crop": row[None]}


def eight_bit(source: Path, target: Path, crops: U8) -> None:
    """Convolutions in 8 bits, calibrated on crops; what places the points stays in float."""
    quantize_static(
        source, target, _Feed(crops), quant_format=QuantFormat.QDQ, op_types_to_quantize=["Conv"],
        activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, per_channel=True,
        reduce_range=True,  # or older processors overflow
    )  # fmt: skip


def session_of(path: Path) -> onnxruntime.InferenceSession:
    """One thread, as the landmarker runs it."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def answers(path: Path, crops: U8) -> tuple[NDArray, NDArray, NDArray]:
    """Points (n, 81, 2), sigma (n, 81), face logit (n,) for crops (n, 128, 128, 3)."""
    session = session_of(path)
    rows = [session.run(None, {"crop": crop[None]}) for crop in crops]
    points, sigma, face = (np.concatenate(column) for column in zip(*rows, strict=True))
    return points, sigma, face


def errors_of(path: Path, crops: Crops) -> F64:
    """Mean error (n,) in per cent of the inter-ocular distance."""
    found = answers(path, crops[0])[0]
    return np.asarray(100 * np.linalg.norm(found - crops[1], axis=2).mean(1) / interocular(crops[1]))


def milliseconds(paths: list[Path], crop: U8, rounds: int = 60) -> list[float]:
    """Median time of one crop for every model, measured in turns."""
    sessions = [session_of(p) for p in paths]
    times = np.zeros((rounds, len(paths)))
    for row in times:
        for k, session in enumerate(sessions):
            start = time.perf_counter()
            session.run(None, {"crop": crop[None]})
            row[k] = 1e3 * (time.perf_counter() - start)
    return [float(t) for t in np.median(times[10:], axis=0)]


def hard_samples(pictures: list[Pictures], count: int, seed: int) -> tuple[U8, NDArray, NDArray]:
    """Augmented crops of the sources in turn, points, and whether there is a face: one in eight shows none."""
    rng = np.random.default_rng(seed)
    cv2.setRNGSeed(seed)
    backgrounds = make_backgrounds(seed)
    crops, points, face = [], [], []
    for k in range(count):
        source = pictures[k % len(pictures)]
        i = int(rng.integers(len(source)))
        there = rng.random() > 0.125
        if there:
            mask = source.masks[i] if len(source.masks) else None
            crop, place, _ = sample(
                rng, source.images[i], source.points[i], source.visible[i], mask, backgrounds
            )
        else:
            crop, place = (
                negative(rng, source.images[i], source.points[i], backgrounds),
                np.zeros((81, 2), np.float32),
            )
        crops.append(crop)
        points.append(place)
        face.append(there)
    return np.stack(crops), np.stack(points), np.array(face)


def calibrate(path: Path, pictures: list[Pictures], count: int = 4000, seed: int = 5) -> dict[str, Any]:
    """Weights of the confidence (see guise.aam.landmarks.builtin.Calibration) and how well they hold on a
    second sample."""
    crops, points, face = hard_samples(pictures, count, seed)
    features, good, ratio = _features(path, crops, points, face)
    start = np.array([-10.0, -4.0, 0.5])

    def cost(weights: F64) -> float:
        z = features @ weights
        return float(np.mean(np.logaddexp(0, z) - good * z) + 1e-5 * (weights**2).sum())

    weights = minimize(cost, start, method="BFGS").x
    features, good, _ = _features(path, *hard_samples(pictures, count, seed + 1))
    chance = 1 / (1 + np.exp(-features @ weights))
    table = []
    for low in np.arange(0, 1, 0.2):
        inside = (chance >= low) & (chance < low + 0.2 + 1e-9)
        if inside.any():
            table.append([float(chance[inside].mean()), float(good[inside].mean()), int(inside.sum())])
    return {
        "face": [round(float(w), 4) for w in weights], "sigma": round(ratio, 4),
        "brier": round(float(np.mean((chance - good) ** 2)), 4), "reliability": np.round(table, 3).tolist(),
    }  # fmt: skip


def _features(path: Path, crops: NDArray, points: NDArray, face: NDArray) -> tuple[NDArray, NDArray, float]:
    """Rows (1, log spread, clipped logit), whether the mean error is small, and measured over told deviation."""
    found, sigma, logit = answers(path, crops)
    eyes = np.maximum(interocular(found), 1e-3)
    spread = np.log(np.maximum(sigma.mean(1) / eyes, 1e-6))
    features = np.column_stack([np.ones(len(crops)), spread, np.clip(logit, -8, 8)])
    miss = np.linalg.norm(found - points, axis=2)
    good = face & (miss.mean(1) < GOOD * np.maximum(interocular(points), 1e-3))
    ratio = float(np.sqrt(np.median(miss[face] ** 2 / sigma[face] ** 2) / (2 * np.log(2))))
    return features, good.astype(float), ratio


def group_errors(path: Path, pictures: Pictures) -> dict[str, float]:
    """Mean error of the held-out rendered people by sex, age and descent, per cent."""
    errors = errors_of(path, plain_crops(pictures, len(pictures)))
    value = dict(zip(pictures.attribute_names, pictures.attributes.T, strict=True))
    groups = {
        "all": np.ones(len(errors), bool), "men": value["male"] >= 0.5, "women": value["male"] < 0.5,
        "young (lower half of age)": value["age"] < 0.35, "old (upper part of age)": value["age"] >= 0.35,
        "mostly African": value["african"] > 0.5, "mostly Asian": value["asian"] > 0.5,
        "mostly European": value["caucasian"] > 0.5, "hair": value["hair"] > 0.5, "no hair": value["hair"] <= 0.5,
    }  # fmt: skip
    return {name: float(errors[who].mean()) for name, who in groups.items() if who.sum() >= 20}


def card_text(facts: dict[str, Any]) -> str:
    """The model card."""
    rows = {
        "groups": [f"| {k} | {v:.2f} |" for k, v in facts["groups"].items()],
        "variants": [
            f"| {k} | {v[0]:.2f} | {v[1]:.2f} | {v[2]:.2f} | {v[3]:,} |" for k, v in facts["variants"].items()
        ],
        "reliability": [f"| {a:.2f} | {b:.2f} | {int(c)} |" for a, b, c in facts["reliability"]],
    }
    return CARD.format(**facts | {name: "\n".join(lines) for name, lines in rows.items()})


CARD = """# Model card: the built-in landmarker

A small convolutional network (`training/landmark_net.py`) that finds the 81 points of a face in an upright crop of
128 x 128 pixels, with a standard deviation for each, and tells whether there is a face at all. Made by
`training/train_landmarks.py` and `training/finish_landmarks.py`; the latter writes this page.

- Licence: that of Guise (Apache-2.0).
- Size: {parameters:,} parameters, {bytes:,} bytes.
- Data: {rendered:,} pictures of {people} rendered people who do not exist (CC0, `training/render_people.py`), and
  {real} pictures of {real_people} real people under CC BY 4.0: photographs of the Face Research Lab London Set
  (DeBruine and Jones 2017, doi:10.6084/m9.figshare.5047666), without those kept for evaluation, and frames of clips of
  the GRID corpus (Cooke et al. 2006), labelled with MediaPipe's points, both kinds of labels brought to one definition
  (`training/definitions.py`). The annotated stills that the benchmarks measure on were not trained on.
- Training: {steps} batches of 64 augmented crops, seed {seed}.
- Meant for faces from about 40 pixels up, turned by up to 45 degrees and rolled by up to 30.
- Not meant for telling who somebody is or what they feel; it does neither.

## Error on rendered people held out

Mean distance in per cent of the distance of the outer eye corners.

| who | error |
|---|---|
{groups}

## Variants

Error on rendered and on real people held out; milliseconds of one crop, one thread, on the machine that wrote this.

| variant | rendered | real | ms | bytes |
|---|---|---|---|---|
{variants}

Shipped: {shipped}.

## Confidence

Predicted and observed share of faces whose mean error is under 5 %, on samples made hard (a second draw, not the one
that the calibration was fitted to). Brier score {brier}.

| predicted | observed | samples |
|---|---|---|
{reliability}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description="Make what ships of a trained landmarker.")
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--real", type=Path, required=True)
    parser.add_argument("--ship", action="store_true", help="copy the result to aam/data")
    options = parser.parse_args()
    cv2.setNumThreads(0)
    run: Path = options.run
    alignment = {
        name: np.array(value) for name, value in json.loads((run / "alignment.json").read_text()).items()
    }
    unseen = apply(alignment, load_parts(options.parts, held_out=True), "rendered")
    real = apply(alignment, load_real(options.real, held_out=True), "real")
    crops = {"rendered": plain_crops(unseen, 600), "real": plain_crops(real, 100)}
    paths = {
        "float32": run / "landmarks.onnx",
        "float16 weights": run / "half.onnx",
        "8-bit": run / "eight.onnx",
    }
    onnx.save(half_precision(onnx.load(paths["float32"])), paths["float16 weights"])
    mixed = np.concatenate([crops["rendered"][0][::4], crops["real"][0]])
    eight_bit(paths["float32"], paths["8-bit"], mixed)
    times = milliseconds(list(paths.values()), crops["real"][0][0])
    variants = {
        name: [*(float(errors_of(path, c).mean()) for c in crops.values()), ms, path.stat().st_size]
        for (name, path), ms in zip(paths.items(), times, strict=True)
    }
    shipped = choose(variants)
    rendered_alone = run / "rendered.onnx"
    plain = load_parts(options.parts, held_out=True), load_real(options.real, held_out=True)
    variants["rendered people alone, labels as given"] = [
        *(float(errors_of(rendered_alone, plain_crops(p, 600)).mean()) for p in plain),
        variants["float32"][2],
        rendered_alone.stat().st_size,
    ]
    fit = calibrate(paths[shipped], [unseen, real])
    (run / "landmarks.json").write_text(
        json.dumps({"face": fit["face"], "sigma": fit["sigma"]}, indent=1) + "\n"
    )
    facts = json.loads((run / "facts.json").read_text()) | fit | {
        "groups": group_errors(paths[shipped], unseen), "variants": variants, "shipped": shipped,
        "bytes": paths[shipped].stat().st_size,
    }  # fmt: skip
    card = card_text(facts)
    (run / "landmarks.md").write_text(card)
    print(card)
    if options.ship:
        shutil.copy(paths[shipped], DATA / "landmarks.onnx")
        shutil.copy(run / "landmarks.json", DATA / "landmarks.json")
        shutil.copy(run / "landmarks.md", DATA / "landmarks.md")
        shutil.copy(run / "alignment.json", Path(__file__).parent / "alignment.json")


def choose(variants: dict[str, list[float]]) -> str:
    """The 8-bit variant if it is faster at the same error, else half-precision weights unless they err more."""
    plain = variants["float32"]
    same = {name: all(v[k] <= LARGEST_LOSS * plain[k] for k in (0, 1)) for name, v in variants.items()}
    if same["8-bit"] and variants["8-bit"][2] < 0.9 * plain[2]:
        return "8-bit"
    return "float16 weights" if same["float16 weights"] else "float32"


if __name__ == "__main__":
    main()
