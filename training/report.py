"""Errors of trained weights on people and pictures held out of training.

    python -m training.report WEIGHTS --parts PARTS --real DATA [--hands HANDS] [--count 600] [--json FILE]

WEIGHTS is an ONNX file (`face.onnx`, `landmarks.onnx`) or `face.pt`. Errors of points are in per cent of the distance
of the outer eye corners, those of irises in per cent of the eye's width.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from guise.aam.parsing import FACE_FRAMING, Framing
from guise.common.arrays import Bool
from training.augment import Props, turned
from training.crops import evenly_spaced, plain_samples
from training.cutouts import make_props
from training.data import Pictures, by_hands, load_parts, load_real
from training.definitions import read_alignment
from training.measure import (
    Answer,
    Answers,
    answers_of,
    answers_of_file,
    figures_of,
    iris_errors,
    point_errors,
)
from training.parsing_labels import CLASSES
from training.real_occluders import load_outlined, outlined_figures

ROLLS_DEGREES = (0, 15, 30, 45, 60)
YAW_RANGES_DEGREES = ((0, 15), (15, 30), (30, 45), (45, 60), (60, 76))

Rows = dict[str, dict[str, float]]


def groups(pictures: Pictures) -> dict[str, Bool]:
    """Which pictures (n,) belong to each group: yaw, brows, beard, glasses, sex, age, descent."""
    value = dict(zip(pictures.attribute_names, pictures.attributes.T, strict=True))
    yaw = np.abs(pictures.pose[:, 0]) if pictures.pose is not None else np.zeros(len(pictures))
    none = np.zeros(len(pictures))
    beard, glasses = value.get("beard", none), value.get("glasses", none)
    up, down = value.get("brows_up", none), value.get("brows_down", none)
    found = {"all": np.ones(len(pictures), bool)}
    found |= {
        f"yaw {low} to {high - high % 5}": (yaw >= low) & (yaw < high) for low, high in YAW_RANGES_DEGREES
    }
    found |= {
        "brows raised": up > 0.6, "brows lowered": down > 0.6, "brows at rest": (up < 0.2) & (down < 0.2),
        "beard": beard > 0.5, "no beard": beard < 0.5, "glasses": glasses > 0.5, "no glasses": glasses < 0.5,
        "men": value["male"] >= 0.5, "women": value["male"] < 0.5, "young": value["age"] < 0.35,
        "old": value["age"] >= 0.35, "mostly African": value["african"] > 0.5, "mostly Asian": value["asian"] > 0.5,
        "mostly European": value["caucasian"] > 0.5,
    }  # fmt: skip
    return found


def by_group(answer: Answer, pictures: Pictures, count: int) -> Rows:
    """Errors of points and irises of every group that has at least ten pictures."""
    chosen = pictures.only(evenly_spaced(pictures, count))
    samples = plain_samples(chosen, len(chosen))
    found = answer(np.stack([s.crop for s in samples]))
    errors = None if found.points is None else point_errors(found, samples)
    rows: Rows = {}
    for name, who in groups(chosen).items():
        if who.sum() < 10:
            continue
        rows[name] = {"pictures": int(who.sum())}
        if errors is not None:
            rows[name]["points"] = float(errors[who].mean())
        if found.iris is not None:
            some = [s for s, w in zip(samples, who, strict=True) if w]
            if any(s.iris_seen.any() for s in some):
                centre, radius = iris_errors(_only(found, who), some)
                rows[name] |= {"iris": float(centre.mean()), "radius": float(radius.mean())}
    return rows


def _only(found: Answers, who: Bool) -> Answers:
    parts = (found.points, found.sigma, found.face, found.iris, found.parsing)
    return Answers(*(None if p is None else p[who] for p in parts))  # type: ignore[arg-type]


def by_class(
    answer: Answer, pictures: Pictures, count: int, props: Props | None, framing: Framing = FACE_FRAMING
) -> dict[str, float]:
    """IoU of every class, their mean, and the percentage of the face's cells classified as occluder."""
    figures = figures_of(answer, plain_samples(pictures, count, props=props, framing=framing))
    if "each" not in figures:
        return {}
    each = dict(zip(CLASSES, np.asarray(figures["each"]).tolist(), strict=True))
    return {"mean": float(figures["iou"]), "false_occluder": float(figures["false_occluder"]), **each}


def by_roll(answer: Answer, pictures: Pictures, count: int) -> dict[int, float]:
    """Error of the points for each roll of the face in the crop, in degrees, in both directions."""
    rows = {}
    for roll in ROLLS_DEGREES:
        rng = np.random.default_rng(roll)
        samples = [
            turned(rng, pictures[int(i)], roll * (1 if k % 2 else -1))
            for k, i in enumerate(evenly_spaced(pictures, count))
        ]
        rows[roll] = float(point_errors(answer(np.stack([s.crop for s in samples])), samples).mean())
    return rows


def report(answer: Answer, unseen: Pictures, real: Pictures, props: Props, count: int) -> dict[str, Any]:
    """All tables: held-out rendered people by group, real people, parsing plain and occluded, rolls."""
    unseen, _ = by_hands(unseen)
    real_samples = plain_samples(real, len(real))
    found = answer(np.stack([s.crop for s in real_samples]))
    return {
        "groups": by_group(answer, unseen, count),
        "real": float(point_errors(found, real_samples).mean()),
        "parsing": by_class(answer, unseen, count, None),
        "occluded": by_class(answer, unseen, count, props),
        "rolls": by_roll(answer, unseen, min(count, 200)),
    }


def tables(facts: dict[str, Any]) -> str:
    """The report as Markdown."""
    lines = [
        "| rendered people held out | pictures | points | iris centre | iris radius |",
        "|---|---|---|---|---|",
    ]
    for name, row in facts["groups"].items():
        rest = " | ".join(f"{row[k]:.2f}" if k in row else "" for k in ("points", "iris", "radius"))
        lines.append(f"| {name} | {row['pictures']} | {rest} |")
    lines += ["", f"Real people held out: points {facts['real']:.2f}.", ""]
    lines += ["| roll in the crop, degrees | points |", "|---|---|"]
    lines += [f"| {roll} | {error:.2f} |" for roll, error in facts["rolls"].items()]
    if facts["parsing"]:
        names = list(facts["parsing"])
        lines += ["", "| parsing, IoU | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
        for kind in ("parsing", "occluded"):
            lines.append(f"| {kind} | " + " | ".join(f"{facts[kind][n]:.3f}" for n in names) + " |")
    if facts.get("outlined"):
        lines += ["", "Real crops, occluders outlined by hand: "]
        lines[-1] += ", ".join(f"{k.replace('_', ' ')} {v:.3f}" for k, v in facts["outlined"].items()) + "."
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure trained weights on held-out people.")
    parser.add_argument("weights", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--real", type=Path, required=True)
    parser.add_argument("--hands", type=Path)
    parser.add_argument("--alignment", type=Path)
    parser.add_argument("--count", type=int, default=600)
    parser.add_argument("--json", type=Path, help="write the figures there")
    options = parser.parse_args()
    alignment = read_alignment(options.alignment)
    unseen = alignment.rendered(load_parts(options.parts, held_out=True))
    real = alignment.real(load_real(options.real, held_out=True))
    props = make_props(99, options.hands, held_out=True, backgrounds=300)
    facts = report(answer_of(options.weights), unseen, real, props, options.count)
    outlined = load_outlined(options.real / "real")
    parsing = answer_of(options.weights)(outlined.crops).parsing
    if parsing is not None:
        facts["outlined"] = outlined_figures(parsing, outlined)
    print(tables(facts))
    if options.json:
        options.json.write_text(json.dumps(facts, indent=1) + "\n")


def answer_of(weights: Path) -> Answer:
    """Predictions of an ONNX file or of PyTorch weights."""
    if weights.suffix != ".pt":
        return answers_of_file(weights)
    import torch

    from training.face_net import FaceNet

    net = FaceNet()
    net.load_state_dict(torch.load(weights, map_location="cpu"))
    return answers_of(net)


if __name__ == "__main__":
    main()
