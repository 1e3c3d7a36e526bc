"""Trains the learned light and writes its model.

    python -m training.train_light --swaps PARTS --photographs LONDON --output RUN [--steps 6000]

PARTS holds the groups of `render_swaps.py`; LONDON photographs of real people, all taken in the same light, so that
their truth is known as well: without them the network takes shading of real skin for another light. Writes
RUN/light.onnx, light.md (its card) and light.pt. The first groups and some of the photographed people are held back and
measured: the Lab error of the lit face against the truth, and of both smoothed as `colour`, next to those of doing
nothing.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from guise.aam.coarse_grid import gaussian_kernel
from guise.app.drawing.passes.light import CELL_FACE_WIDTHS, GRID
from training import swap_data
from training.light_batches import Batch, Batches, Lights, Portraits
from training.light_net import LightNet, weights
from training.stored_weights import quarter
from training.swap_data import Cells, Samples

COLOUR_SIGMA_FACE_WIDTHS = 0.05  # at which colours are compared
WARM_UP, FALLING, KEPT_OF_MEAN = 200, 0.3, 0.999  # steps, last share of the steps, share
REPORT_STEPS = 200
PEOPLE_HELD_BACK = 8  # of those on photographs


XYZ = torch.tensor(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
)
WHITE = torch.tensor([0.950456, 1.0, 1.088754])


def lab(planes: Tensor) -> Tensor:
    """CIE Lab (n, 3, h, w) of RGB 0..255."""
    rgb = (planes / 255).clamp(1e-4, 1)
    linear = torch.where(rgb > 0.04045, ((rgb + 0.055) / 1.055) ** 2.4, rgb / 12.92)
    xyz = torch.einsum("rc,nchw->nrhw", XYZ / WHITE[:, None], linear)
    f = torch.where(xyz > 0.008856, xyz.clamp(min=1e-6) ** (1 / 3), 7.787 * xyz + 16 / 116)
    return torch.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], 1)


class Errors:
    """Lab distances of cells, at their own size and smoothed."""

    def __init__(self) -> None:
        sigma = COLOUR_SIGMA_FACE_WIDTHS / CELL_FACE_WIDTHS
        self._kernels = [torch.tensor(gaussian_kernel(n, sigma, 0.0, 0.0)) for n in GRID]

    def __call__(self, made: Tensor, truth: Tensor, shown: Tensor) -> tuple[Tensor, Tensor]:
        """Mean over what is shown (n, h, w) of pictures (n, 3, h, w): plain, smooth, each (n,)."""
        difference = lab(made) - lab(truth)
        weight = shown[:, None]
        smooth = self._smooth(difference * weight) / self._smooth(weight).clamp(min=1e-3)
        total = shown.sum((1, 2)).clamp(min=1)
        plain, smooth = (
            ((d.square().sum(1) + 0.05).sqrt() * shown).sum((1, 2)) / total for d in (difference, smooth)
        )
        return plain, smooth

    def _smooth(self, planes: Tensor) -> Tensor:
        return self._kernels[0] @ planes @ self._kernels[1]


class Lit(nn.Module):
    """The network's map applied to means of cells."""

    def __init__(self, net: LightNet, cells: Cells) -> None:
        super().__init__()
        self.net = net
        parts = torch.tensor(cells.parts)
        self.register_buffer("parts", parts)
        self.register_buffer("surface", 1 - parts.max(0).values)

    def forward(self, batch: Batch) -> Tensor:
        """The face in the light of the scene (n, 3, h, w)."""
        found, gains = self.net(batch.skin, batch.other, batch.own, batch.rest)
        gain = found[:, :3] * self.surface + torch.einsum("npc,phw->nchw", gains, self.parts)
        return batch.face * gain + found[:, 3:] * self.surface


def measure(lit: Callable[[Batch], Tensor] | None, batches: Batches, rows: np.ndarray) -> dict[str, float]:
    """Mean errors of the lit face, or of doing nothing; `gain` as in a comparison with doing nothing."""
    return compared(lit, (batches.plain(some) for some in np.array_split(rows, max(1, len(rows) // 48))))


@torch.no_grad()
def compared(lit: Callable[[Batch], Tensor] | None, some: Iterable[Batch]) -> dict[str, float]:
    """The same of batches."""
    errors, found = Errors(), []
    for batch in some:
        made = batch.untouched if lit is None else lit(batch)
        nothing = errors(batch.untouched, batch.truth, batch.shown)[0]
        found.append(torch.stack([*errors(made, batch.truth, batch.shown), nothing]))
    error, colour, nothing = torch.cat(found, 1).mean(1).tolist()
    return {"error": error, "colour": colour, "gain": 1 - error / nothing}


def loss_of(lit: Lit, batch: Batch, errors: Errors) -> Tensor:
    """Mean error of a batch relative to doing nothing, plain and smooth together."""
    plain, smooth = errors(lit(batch), batch.truth, batch.shown)
    nothing = errors(batch.untouched, batch.truth, batch.shown)[0]
    return ((plain + smooth) / (nothing + 2)).mean()


def train(
    net: LightNet,
    samples: Samples,
    cells: Cells,
    lights: Lights,
    held_back: np.ndarray,
    options: argparse.Namespace,
    real: tuple[Portraits, Portraits] | None = None,
) -> dict[str, dict[str, float]]:
    """Train in place; the net ends as the running mean of its weights. Figures of what is held back."""
    rng = np.random.default_rng(options.seed)
    torch.manual_seed(options.seed)
    is_held = np.isin(samples.group, held_back)
    batches, lit, errors = Batches(samples[~is_held], cells, lights), Lit(net, cells), Errors()
    held = samples[is_held & ~samples.keeps_face]
    check, rows = Batches(held, cells), np.arange(0, len(held.group), 3)
    print(
        f"{len(samples.group)} samples, {weights(net)} weights; nothing {_said(measure(None, check, rows))}",
        flush=True,
    )
    others = {"nothing": measure(None, check, rows)}
    print(f"start {_said(measure(lit, check, rows))}", flush=True)
    optimiser = torch.optim.AdamW(net.parameters(), options.rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimiser,
        lambda step: min(1.0, (step + 1) / WARM_UP, (options.steps - step) / (FALLING * options.steps)),
    )
    mean = {name: value.clone() for name, value in net.state_dict().items()}
    start = time.time()
    for step in range(1, options.steps + 1):
        loss = loss_of(lit, batches.random(options.batch, rng), errors)
        if real is not None:
            loss = loss + options.real_weight * loss_of(lit, real[0].random(options.batch // 2, rng), errors)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimiser.step()
        schedule.step()
        kept = min(KEPT_OF_MEAN, 1 - 10 / (step + 10))
        for name, value in net.state_dict().items():
            mean[name].lerp_(value, 1 - kept)
        if step % REPORT_STEPS == 0 or step == options.steps:
            now = {name: value.clone() for name, value in net.state_dict().items()}
            net.load_state_dict(mean)
            seconds, figures = time.time() - start, _said(measure(lit, check, rows))
            if real is not None:
                figures += "; photographs " + _said(compared(lit, real[1].few()))
            print(f"{step}: {seconds:.0f} s, loss {float(loss.detach()):.3f}, {figures}", flush=True)
            torch.save(mean, options.output / "light.pt")
            if step < options.steps:
                net.load_state_dict(now)
    return {**others, "learned light": measure(lit, check, rows)}


def _said(figures: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3f}" for name, value in figures.items())


CARD = """# Model card: the learned light

A small convolutional network (`training/light_net.py`, {weights:,} weights) that gives a synthesised face the light and
the skin tone of a frame. It sees means of both, and of both people as enrolled, on a grid of 41 x 35 cells and gives an
affine map of colours for each cell; it cannot add what the face does not have.

- Licence: that of Guise (Apache-2.0).
- Data: {samples:,} swaps of {groups} groups of four rendered people who do not exist (CC0,
  `training/render_swaps.py`), each on the heads of the others where the engine draws it, made even and fit
  for the head's tone as the engine does, under the points that the shipped landmarker finds, mirrored as well; and
  {photographs} of
  the Face Research Lab London Set (CC BY 4.0; DeBruine and Jones 2017, doi:10.6084/m9.figshare.5047666), all taken in
  the same light, in random smooth lights and those of the rendered scenes: each to become the same person's other
  photograph in that light, or another's in that light and the skin tone of the first.
- Training: `training/train_light.py`, {steps} batches of {batch}, some in other lights, under random exposure, white
  balance, gamma, saturation, noise and occlusions.
- Not meant for telling who somebody is or what they feel; it does neither.

## Error on rendered people held back

Mean Lab distance from the ideal swap, of means of cells and of these smoothed by 0.05 face widths (`colour`); gain is
1 - error / error of doing nothing.

| what | error | colour | gain |
|---|---|---|---|
{rows}
"""


def card(figures: dict[str, dict[str, float]], **about: object) -> str:
    """The model card."""
    rows = [
        f"| {name} | " + " | ".join(f"{value:.2f}" for value in row.values()) + " |"
        for name, row in figures.items()
    ]
    return CARD.format(rows="\n".join(rows), **about)


def export(net: LightNet, path: Path) -> None:
    """Write the network as ONNX, its weights in 8 bits."""
    sums = torch.rand(1, 7, *GRID) + 0.5
    means = 255 * torch.rand(1, 2, 3, *GRID)
    torch.onnx.export(
        net.eval(), (sums, sums.clone(), means, means.clone()), str(path),
        input_names=["skin", "other", "own", "rest"], output_names=["map", "parts"], opset_version=17, dynamo=False,
    )  # fmt: skip
    quarter(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--swaps", type=Path, required=True, help="folder of the rendered groups")
    parser.add_argument("--photographs", type=Path, help="folder pairs/london")
    parser.add_argument("--real-weight", type=float, default=0.5)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--rate", type=float, default=1e-3)
    parser.add_argument("--held-back", type=int, default=4, help="groups")
    parser.add_argument("--first-weights", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    cells = Cells()
    samples = swap_data.load(sorted(options.swaps.glob("group_*.npz")), cells)
    lights, real = Lights(swap_data.light_fields(samples, cells)), None
    if options.photographs:
        means, people = swap_data.portraits(options.photographs, cells)
        known = [person not in sorted(set(people))[:PEOPLE_HELD_BACK] for person in people]
        real = tuple(
            Portraits(means[rows], [people[i] for i in rows], lights, cells)
            for rows in (np.flatnonzero(known), np.flatnonzero(np.logical_not(known)))
        )
    net = LightNet()
    if options.first_weights:
        net.load_state_dict(
            {k: v for k, v in torch.load(options.first_weights).items() if k in dict(net.named_parameters())},
            strict=False,
        )
    groups = np.unique(samples.group)
    figures = train(net, samples, cells, lights, groups[: options.held_back], options, real)
    export(net, options.output / "light.onnx")
    known = real[0].people if real is not None else []
    about = {"weights": weights(net), "steps": options.steps, "batch": options.batch}
    about["photographs"] = f"{len(known)} photographs of {len(set(known))} people"
    text = card(figures, samples=len(samples.group), groups=len(groups) - options.held_back, **about)
    (options.output / "light.md").write_text(text)


if __name__ == "__main__":
    main()
