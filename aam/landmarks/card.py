"""The TOML card that describes a landmark model.

The card says everything that is needed to feed the model and to read it::

    name = "pfld"                 # optional, for reports; the card's file name without it
    model = "pfld.onnx"           # path, relative to the card
    scheme = "ibug68"             # a landmark scheme: face81, ibug68
    sha256 = "64184e22..."        # optional; checked when there
    licence = "Apache-2.0"        # optional, free text
    source = "https://..."        # optional, free text

    [input]
    size = [112, 112]             # width, height in pixels
    colour = "rgb"                # rgb, bgr or gray; default rgb
    layout = "nchw"               # nchw or nhwc; default nchw
    mean = 0                      # value = (byte - mean) * scale, byte in 0..255;
    scale = 0.00392156862745098   # one number or one per channel; default: mean 0, scale 1/255

    [crop]
    enlarge = 1.1                 # square of this times the longer side of the landmarks' box; default 1
    upright = false               # turn the crop so that the outer eye corners are level; default false

    [output]
    name = "output"               # optional; the model's first output
    order = "interleaved"         # x y x y ... (default) or "split": x x ... y y ...
    unit = "fraction"             # of the crop, 0 to 1, or "pixels" of the input; default fraction

    [box.lbp]                     # optional, per detector: replaces the detector's own adjustment
    scale = 0.84                  # side of the landmarks' box / longer side of the detector's box
    shift = [0.0, 0.18]           # its centre, moved by these times that side, x right, y down

    [start]
    passes = 3                    # crops in all, from a detector's box on; default 3

The landmarks' box is the tight box of the scheme's own points. After a detection the first crop comes from
the detector's box, the next ones from the landmarks just found; to follow a face one pass is enough, from the
landmarks of the frame before. Pixels beyond the picture are black.

Pixels, x right, y down, pixel centres at integers: the fraction u of a crop that begins at x0 and is s wide
lies at x0 + u s. Paths are relative to the card.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from guise.aam.landmarks.face import BoxFit, LandmarkError
from guise.aam.landmarks.schemes import Scheme, scheme_named
from guise.aam.model_card import CardReader, ModelCard, is_list, is_number

_ORDERS = ("interleaved", "split")
_UNITS = ("fraction", "pixels")
_KEYS: Mapping[str, tuple[str, ...]] = {
    "": ("scheme", "box"),
    "crop": ("enlarge", "upright"),
    "output": ("name", "order", "unit"),
    "start": ("passes",),
}
_MOST_PASSES = 20


@dataclass(frozen=True, eq=False, kw_only=True)
class LandmarkCard(ModelCard):
    """What the card of a landmark model says; see the module's text for the meaning of each field."""

    kind: ClassVar[str] = "landmark"
    error: ClassVar[type[LandmarkError]] = LandmarkError
    colours: ClassVar[tuple[str, ...]] = ("rgb", "bgr", "gray")

    scheme: Scheme
    enlarge: float = 1.0
    upright: bool = False
    output: str | None = None
    order: str = "interleaved"
    unit: str = "fraction"
    boxes: Mapping[str, BoxFit] | None = None
    passes: int = 3


def read_card(path: str | Path) -> LandmarkCard:
    """The card in a TOML file; LandmarkError, in one sentence, for anything wrong in it."""
    reader = CardReader(path, LandmarkCard, _KEYS)
    return LandmarkCard(
        **reader.common(),
        scheme=scheme_named(reader.text("", "scheme", None)),
        enlarge=reader.positive("crop", "enlarge", 1.0),
        upright=reader.flag("crop", "upright"),
        output=reader.text("output", "name", "") or None,
        order=reader.choice("output", "order", _ORDERS),
        unit=reader.choice("output", "unit", _UNITS),
        boxes={name: _box_fit(reader, name, entry) for name, entry in reader.section("box").items()},
        passes=reader.count("start", "passes", 3, _MOST_PASSES),
    )


def _box_fit(reader: CardReader, name: str, entry: Any) -> BoxFit:
    """The adjustment for one detector."""
    if not isinstance(entry, dict) or set(entry) - {"scale", "shift"}:
        raise reader.fault("box", name, "a table with scale and shift", entry)
    scale, shift = entry.get("scale", 1.0), entry.get("shift", [0.0, 0.0])
    if not is_number(scale) or not scale > 0:
        raise reader.fault("box", f"{name}.scale", "a number above 0", scale)
    if not is_list(shift, 2) or not all(is_number(v) for v in shift):
        raise reader.fault("box", f"{name}.shift", "[x, y]", shift)
    return BoxFit(float(scale), (float(shift[0]), float(shift[1])))
