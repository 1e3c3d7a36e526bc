"""Turn the weights of a training for whole heads into what ships: an ONNX file and its model card.

    python -m training.finish_head --run OUT --parts PARTS --real DATA [--hands HANDS] [--ship]

OUT is the output of `train_face.py` with --goal head, PARTS that of `render_people.py` with small faces. Writes
`head.onnx` (output `parsing`; in 8 bits if that is faster and no less accurate), `report.json` and `head.md` there.
With --ship they go to aam/data.
"""

from __future__ import annotations

import copy
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor, nn

from guise.aam.parsing import HEAD_FRAMING
from training.crops import plain_samples
from training.face_net import FaceNet
from training.finish_face import arguments, eight_bit, export, milliseconds
from training.finish_parsing import MAX_IOU_LOSS, begun, finish, shares_of
from training.measure import answers_of_file, figures_of
from training.parsing_labels import CLASSES
from training.report import by_class

SHOWN = ("background", "skin", "hair", "facial_hair", "glasses", "occluder")  # features are a few cells large

CARD = """# Model card: parsing of heads

A small convolutional network (`training/face_net.py`) that tells what each of 64 x 64 cells shows in an upright crop of
128 x 128 pixels that holds a whole head, long hair and the shoulders ({side} times the longer side of the face's box).
The classes are {classes}.
Made by `training/train_face.py --goal {goal}` and `training/finish_head.py`; the latter writes this page.

- Licence: that of Guise (Apache-2.0).
- File: {bytes} bytes, about {ms:.2f} ms a crop on one core of an ordinary CPU.
- Data: {rendered} rendered pictures of {people} people who do not exist (CC0 assets; `training/render_people.py`),
  {held} of them with a hand before the face, with procedural backgrounds and objects in front, and {real} pictures of
  {real_people} real people under CC BY 4.0: photographs of the Face Research Lab London Set (DeBruine and Jones 2017,
  doi:10.6084/m9.figshare.5047666), without those kept for evaluation, and frames of clips of the GRID corpus (Cooke et
  al. 2006). In real pictures it is only known which classes a cell cannot show.
- Training: {done} batches of {batch} augmented crops, seed {seed}, from the weights of a first course, which began with
  those of the parsing of faces.
- Meant for faces from about 30 pixels up, turned by up to 60 degrees, in a crop made upright by their points.
- Not meant for recognising people; it does not.

## Held out

IoU of the most likely class on rendered people held out: plain, with one object before each face, and with a hand that
was rendered before the face. Hats, scarves and hair styles beyond the ten of the renderer were not measured.

{parsing}
"""


class _HeadParser(nn.Module):
    """The network's parsing alone."""

    def __init__(self, net: FaceNet) -> None:
        super().__init__()
        self.net = net

    def forward(self, images: Tensor) -> Tensor:
        stem, pyramid, _ = self.net.features(images)
        return shares_of(self.net, stem, pyramid)


def card(facts: dict[str, Any]) -> str:
    """The model card."""
    kinds = ("plain", "occluded", "hand")
    table = ["| | " + " | ".join(kinds) + " |", "|---|---|---|---|"]
    for name in facts["plain"]:
        figures = " | ".join(f"{facts[kind][name]:.3f}" for kind in kinds)
        if name in SHOWN:
            table.append(f"| {name.replace('_', ' ')} | {figures} |")
    return CARD.format(
        **facts["training"], bytes=facts["bytes"], ms=facts["ms"], side=HEAD_FRAMING.side,
        classes=", ".join(c.replace("_", " ") for c in CLASSES), parsing="\n".join(table),
    )  # fmt: skip


def main() -> None:
    options = arguments(
        "Turn trained weights for the parsing of heads into what ships.",
        "copy the network and its card to aam/data",
    )
    run: Path = options.run
    net, held_out = begun(options, HEAD_FRAMING)
    unseen, props = held_out.unseen, held_out.props
    plain = plain_samples(unseen, min(options.count, 300), framing=HEAD_FRAMING)
    hidden = plain_samples(unseen, 150, props=props, framing=HEAD_FRAMING)
    crops = np.stack([s.crop for s in hidden + plain[::3] + held_out.real])
    files = run / "head_float32.onnx", run / "head_8bit.onnx"
    export(_HeadParser(copy.deepcopy(net).float()), files[0], ("parsing",))
    eight_bit(*files, crops)
    times = milliseconds(list(files), crops[0])
    found = [figures_of(answers_of_file(file), plain)["iou"] for file in files]
    print({"iou": found, "ms": times})
    chosen = int(found[1] >= found[0] - MAX_IOU_LOSS and times[1] < times[0])
    shutil.copy(files[chosen], run / "head.onnx")
    answer = answers_of_file(run / "head.onnx")
    facts: dict[str, Any] = {
        "plain": by_class(answer, unseen, options.count, None, HEAD_FRAMING),
        "occluded": by_class(answer, unseen, options.count, props, HEAD_FRAMING),
        "hand": by_class(answer, held_out.behind, options.count, None, HEAD_FRAMING),
    }
    finish(options, run / "head.onnx", times[chosen], facts, card)


if __name__ == "__main__":
    main()
