"""Turn the weights of a training for irises and parsing into what ships: an ONNX file and its model card.

    python -m training.finish_parsing --run OUT --parts PARTS --real DATA [--hands HANDS] [--ship]

OUT is the output of `train_face.py` with --goal parsing or refinement. Writes `face.onnx` (outputs `iris` and
`parsing`; in 8 bits if that is faster and no less accurate), `report.json` and `face.md` there. With --ship they go to
aam/data.
"""

from __future__ import annotations

import argparse
import copy
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from guise.aam.parsing import FACE_FRAMING, Framing
from training.augment import Props
from training.canvas import Sample
from training.crops import plain_samples
from training.cutouts import make_props
from training.data import Pictures, by_hands, load_parts, load_real
from training.definitions import read_alignment
from training.face_net import FaceNet
from training.finish_face import DATA, arguments, eight_bit, export, milliseconds
from training.measure import AGREEMENT_EVERY, answers_of_file, figures_of, fused_apart
from training.parsing_labels import CLASSES
from training.real_occluders import load_outlined, outlined_figures
from training.report import by_class, by_group

MAX_IOU_LOSS = 0.01  # of the 8-bit file, beside the float32 one
MAX_IRIS_RATIO = 1.05


Card = Callable[[dict[str, Any]], str]


class FaceParser(nn.Module):
    """The network without points."""

    def __init__(self, net: FaceNet) -> None:
        super().__init__()
        self.net = net

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        stem, pyramid, _ = self.net.features(images)
        return self.net.irises_of(pyramid), shares_of(self.net, stem, pyramid)


def shares_of(net: FaceNet, stem: Tensor, pyramid: Tensor) -> Tensor:
    """Share of each class (n, classes, 64, 64), from features; faster than the softmax of the runtime."""
    chance = torch.exp(net.parsing_of(stem, pyramid).clamp(-40, 40))
    return chance / chance.sum(1, keepdim=True)


CARD = """# Model card: irises and face parsing

A small convolutional network (`training/face_net.py`) that tells, in an upright crop of 128 x 128 pixels about a face,
what each of 64 x 64 cells shows, and gives centre, radius and a standard deviation for both irises. The classes are
{classes}.
Made by `training/train_face.py --goal {goal}` and `training/finish_parsing.py`; the latter writes this page.

- Licence: that of Guise (Apache-2.0).
- Size: {bytes:,} bytes; {ms:.1f} ms for one crop on one core of the machine that wrote this.
- The same on every processor, as all scales of 8 bits are powers of two (`training/exact_rounding.py`). Answers for
  {compared} crops, as the runtime fuses the network and operator by operator, differ by at most {fused:.1g} of an
  output's range; `tests/test_networks_agree.py` holds answers to compare processors with.
- Data: {rendered:,} pictures of {people} rendered fictional people (CC0, `training/render_people.py`), {held:,} of them
  with a hand before the face (`training/hands.py`), cut-outs of rendered hands (`training/render_hands.py`), procedural
  objects in front (`training/occluders.py`), and {real} pictures of {real_people} real people under CC BY 4.0:
  photographs of the Face Research Lab London Set (DeBruine and Jones 2017, doi:10.6084/m9.figshare.5047666), without
  those kept for evaluation, and frames of clips of the GRID corpus (Cooke et al. 2006). In real pictures it is only
  known which classes a cell cannot show.
- Training: {done} batches of {batch} augmented crops, seed {seed}, {start}.
- Meant for faces from about 40 pixels up, turned by up to 60 degrees, in a crop made upright by their points.
- Not meant for recognising people or their emotions; it does neither.

## Held out

Errors of irises in per cent of the eye's width and of the radius, on rendered people held out.

{irises}

IoU of the most likely class on rendered people held out: plain, with one object before each face, hands and
backgrounds held out too, and with a hand that was rendered before the face; and the percentage of the face's cells
called occluder.

{parsing}

{outlined}
"""


def card(facts: dict[str, Any]) -> str:
    """The model card."""
    lines = ["| rendered people held out | pictures | iris centre | iris radius |", "|---|---|---|---|"]
    for name, row in facts["groups"].items():
        if "iris" in row:
            lines.append(f"| {name} | {row['pictures']} | {row['iris']:.2f} | {row['radius']:.2f} |")
    kinds = [kind for kind in ("plain", "occluded", "hand") if facts.get(kind)]
    table = ["| | " + " | ".join(kinds) + " |", "|---" * (len(kinds) + 1) + "|"]
    for name in facts["plain"]:
        figures = " | ".join(f"{facts[kind][name]:.3f}" for kind in kinds)
        table.append(f"| {name.replace('_', ' ')} | {figures} |")
    row = facts["outlined"]
    outlined = (
        f"On {row['crops']:.0f} crops of real videos, a third of them with hands outlined by hand "
        f"(`training/real_occluders.json`): occluder IoU {row['occluder_iou']:.3f} within the face, "
        f"{row['false_occluder']:.2f} % of its other cells called occluder."
    )
    return CARD.format(
        **facts["training"], bytes=facts["bytes"], ms=facts["ms"],
        compared=facts["compared"], fused=facts["fused"],
        classes=", ".join(c.replace("_", " ") for c in CLASSES), irises="\n".join(lines), parsing="\n".join(table),
        outlined=outlined,
    ).rstrip() + "\n"  # fmt: skip


@dataclass(frozen=True, eq=False)
class HeldOut:
    """What is measured on: rendered people without and with a hand before the face, real crops, and objects."""

    unseen: Pictures
    behind: Pictures
    real: list[Sample]
    props: Props


def begun(options: argparse.Namespace, framing: Framing) -> tuple[FaceNet, HeldOut]:
    """A run's network, and what it is measured on."""
    cv2.setNumThreads(0)
    torch.set_num_threads(1)
    alignment = read_alignment(options.alignment)
    unseen, behind = by_hands(alignment.rendered(load_parts(options.parts, held_out=True)))
    real = alignment.real(load_real(options.real, held_out=True, framing=framing))
    props = make_props(99, options.hands, held_out=True, backgrounds=300)
    net = FaceNet()
    net.load_state_dict(torch.load(options.run / "face.pt", map_location="cpu"))
    return net, HeldOut(unseen, behind, plain_samples(real, 40, framing=framing), props)


def finish(options: argparse.Namespace, file: Path, ms: float, facts: dict[str, Any], card: Card) -> None:
    """Write a network's report and card beside its file, and ship it if that is asked for."""
    facts |= {
        "ms": ms, "bytes": file.stat().st_size, "training": json.loads((options.run / "facts.json").read_text()),
    }  # fmt: skip
    (options.run / "report.json").write_text(json.dumps(facts, indent=1) + "\n")
    page = file.with_suffix(".md")
    page.write_text(card(facts))
    print(card(facts))
    if options.ship:
        for one in (file, page):
            shutil.copy(one, DATA / one.name)


def main() -> None:
    options = arguments(
        "Turn trained weights for irises and parsing into what ships.",
        "copy the network and its card to aam/data",
    )
    run: Path = options.run
    net, held_out = begun(options, FACE_FRAMING)
    unseen, behind, props = held_out.unseen, held_out.behind, held_out.props
    plain = plain_samples(unseen, min(options.count, 300))
    hidden = plain_samples(unseen, 150, props=props) + plain_samples(behind, 100)
    calibration = np.stack([s.crop for s in hidden + plain[::3] + held_out.real])
    files = run / "face_float32.onnx", run / "face_8bit.onnx"
    export(FaceParser(copy.deepcopy(net).float()), files[0], ("iris", "parsing"))
    eight_bit(*files, calibration)
    times = milliseconds(list(files), held_out.real[0].crop)
    rows = [figures_of(answers_of_file(file), plain) for file in files]
    print(
        [
            {k: v for k, v in row.items() if k != "each"} | {"ms": ms}
            for row, ms in zip(rows, times, strict=True)
        ]
    )
    same = (
        rows[1]["iou"] >= rows[0]["iou"] - MAX_IOU_LOSS
        and rows[1]["iris"] <= MAX_IRIS_RATIO * rows[0]["iris"]
    )
    chosen = int(bool(same) and times[1] < times[0])
    shutil.copy(files[chosen], run / "face.onnx")
    answer = answers_of_file(run / "face.onnx")
    outlined = load_outlined(options.real / "real")
    parsing = answer(outlined.crops).parsing
    assert parsing is not None
    facts: dict[str, Any] = {
        "groups": by_group(answer, unseen, options.count),
        "plain": by_class(answer, unseen, options.count, None),
        "occluded": by_class(answer, unseen, options.count, props),
        "hand": by_class(answer, behind, options.count, None) if len(behind) else {},
        "outlined": outlined_figures(parsing, outlined),
        "compared": len(calibration[::AGREEMENT_EVERY]),
        "fused": fused_apart(run / "face.onnx", calibration[::AGREEMENT_EVERY]),
    }
    finish(options, run / "face.onnx", times[chosen], facts, card)


if __name__ == "__main__":
    main()
