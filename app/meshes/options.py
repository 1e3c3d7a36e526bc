"""How expressions are transferred between heads, as a user says it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from guise.common.option import option

Unit = Literal["m", "dm", "cm", "mm", "in"]  # of the lengths in a mesh file


@dataclass(frozen=True)
class TransferOptions:
    """How expressions are transferred.

    landmarks : files of feature points of source and target, or "auto" to detect them; None detects both.
    """

    method: Literal["tents", "deformable", "gradients", "cloning"] = option(
        "tents",
        "Vertex tents, the deformable model, or what tents are compared with: deformation gradients, cloning.",
    )
    correspondence: Literal["dense", "cylinder"] = option(
        "dense", "Match the heads by deforming one onto the other, or by cylindrical projection."
    )
    guides: Literal["contours", "none"] = option(
        "none",
        "Let feature points and lids alone guide the dense match, or contours of cheeks, jaw and neck, too.",
    )
    landmarks: tuple[str, str] | None = option(
        None,
        "Feature points of both heads, as written by `landmarks`; `auto` detects them.",
        metavar="SOURCE.json TARGET.json",
    )
    parts: Path | None = option(
        None,
        "What the parts of TARGET are, as `landmarks --parts-out` writes it; you may change its kinds.",
        metavar="PARTS.toml",
    )
    keep_rigid: bool = option(False, "Keep eyes, teeth and other parts of the target in place.")
