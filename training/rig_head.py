"""Trains what tells ARKit's coefficients of a face, beside another picture of the same person.

    python -m training.rig_head train --sights SIGHTS [SIGHTS ...] --output one.npz --alike 0.3
    python -m training.rig_head train --sights SIGHTS [SIGHTS ...] --output two.npz --seed 2 --basis one.npz
    python -m training.rig_head join one.npz two.npz --output rig.npz

SIGHTS are those of `rig_sights.py` and `rig_real.py`.  What a sight shows (`guise.aam.rig.sight`) is reduced to
principal components, those of both eyes shared, or those of `--basis`, an earlier network; a small network tells the
coefficients from them and from how they differ from those of a reference: a picture of the same person in the same
sitting whose coefficients it is told, at run time rest.  One time in five there is none.  People are mirrored at
random.  What ships is the mean of several networks: with `--alike`, small moves count like large ones.
"""

from __future__ import annotations

import argparse
import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from guise.aam.landmarks.schemes import IBUG68, MIRROR
from guise.aam.rig.coefficients import LOOKS, TOLD
from guise.aam.rig.names import ARKIT_NAMES, FULL_LOOK_DEGREES
from guise.aam.rig.sight import IRIS_RADII, iris_values, window_values
from guise.common.arrays import F32, Int
from training.rig_sights import REAL, STILLS

KEPT = {"eye": 72, "mouth": 88, "shape": 56}  # principal components
WIDTHS, LOOK_WIDTHS = (192, 128), (64, 32)  # of the hidden layers
IRISES = 4 * len(IRIS_RADII)  # values of both
NAMES = [ARKIT_NAMES[k] for k in TOLD]
OUTPUTS = len(TOLD) + 2  # and the eyes' turn
GROUPS, REAL_GROUPS, STILL_GROUPS, PER_GROUP = 44, 6, 8, 12  # in a batch
MOVES, CLEARLY = (
    0.02,
    0.2,
)  # standard deviation of a coefficient there, from which on it counts, and counts whole
ALONE, CALM = 0.2, 0.6  # shares without a reference, and with the calmest picture of the sitting as that


class Sights:
    """All sights in memory, by group; people whose number ends in `first` to `last` - 1."""

    def __init__(self, folders: list[Path], first: int, last: int) -> None:
        columns: dict[str, list[Any]] = {}
        for file in sorted(file for folder in folders for file in folder.glob("part_*.npz")):
            with np.load(file) as stored:
                kept = (stored["person"] % 10 >= first) & (stored["person"] % 10 < last)
                for key in stored.files:
                    columns.setdefault(key, []).append(stored[key][kept])
        joined = {key: np.concatenate(rows) for key, rows in columns.items()}
        # as they are, and in a mirror
        self.shape = np.stack(
            [joined["shape"].astype(np.float32), _mirrored_shape(joined["shape"].astype(np.float32))]
        )
        eyes = np.array([[window_values(eye) for eye in both] for both in joined["eyes"]])
        self.eyes = np.stack([eyes, eyes[:, ::-1]])
        irises = np.array([[iris_values(eye) for eye in both] for both in joined["eyes"]])
        self.irises = np.stack([irises, irises[:, ::-1]])
        mouths = joined["mouth"]
        self.mouth = np.stack(
            [[window_values(np.ascontiguousarray(one[:, ::way])) for one in mouths] for way in (1, -1)]
        )
        weights = joined["weights"]
        self.truth = np.column_stack([weights[:, TOLD], weights[:, 52:] / FULL_LOOK_DEGREES]).astype(
            np.float32
        )
        self.glasses = joined["glasses"]
        order = np.argsort(joined["group"], kind="stable")
        ends = np.flatnonzero(np.diff(joined["group"][order])) + 1
        self.groups: list[Int] = [rows for rows in np.split(order, ends) if len(rows) > 3]
        number = joined["group"]
        self.rendered = [rows for rows in self.groups if number[rows[0]] < REAL]
        self.real = [rows for rows in self.groups if REAL <= number[rows[0]] < STILLS]
        self.stills = [rows for rows in self.groups if number[rows[0]] >= STILLS]

    def components(self, basis: dict[str, F32]) -> tuple[Tensor, Tensor]:
        """Components (2, n, k) and truth (2, n, 46), as they are and in a mirror."""
        parts = [(self.mouth - basis["mouth_mean"]) @ basis["mouth"]]
        parts += [(self.eyes[:, :, k] - basis["eye_mean"]) @ basis["eye"] for k in (0, 1)]
        parts += [
            (self.shape - basis["shape_mean"]) @ basis["shape"],
            self.irises[:, :, 0],
            self.irises[:, :, 1],
        ]
        truth = np.stack([self.truth, self.truth[:, _SWAPPED] * _SIGNS])
        return torch.from_numpy(np.concatenate(parts, 2)).float(), torch.from_numpy(truth).float()


def _mirrored_shape(shape: F32) -> F32:
    points = shape[:, :-3].reshape(-1, 68, 2)[:, [MIRROR[k] for k in IBUG68]] * (-1, 1)
    return np.concatenate([points.reshape(len(shape), -1), shape[:, -3:] * (-1, 1, -1)], axis=1).astype(
        np.float32
    )


def _swapped() -> list[int]:
    found = []
    for name in NAMES:
        for one, other in (("Left", "Right"), ("Right", "Left")):
            if name.endswith(one):
                name = name[: -len(one)] + other
                break
        found.append(NAMES.index(name))
    return [*found, OUTPUTS - 2, OUTPUTS - 1]


_SWAPPED = _swapped()
_SIGNS = np.array([*[1.0] * (OUTPUTS - 2), -1.0, 1.0])


def principal(values: F32, count: int) -> tuple[F32, F32]:
    """Mean (v,) and the first directions (v, count), each scaled so that its values spread by about one."""
    middle = values.mean(0)
    centred = values - middle
    spread, ways = np.linalg.eigh((centred.T @ centred / len(centred)).astype(np.float64))
    spread, ways = spread[::-1][:count], ways[:, ::-1][:, :count]
    return middle.astype(np.float32), (ways / np.sqrt(spread + 0.02 * spread[0])).astype(np.float32)


def basis_of(data: Sights) -> dict[str, F32]:
    """Principal components of all kinds."""
    made = {}
    kinds = {"eye": data.eyes, "mouth": data.mouth, "shape": data.shape}
    for name, values in kinds.items():
        values = values.reshape(-1, values.shape[-1])
        made[f"{name}_mean"], made[name] = principal(values, KEPT[name])
    return made


def stored_basis(path: Path) -> dict[str, F32]:
    """That of a file that `save` wrote."""
    with np.load(path) as stored:
        return {name: stored[name].astype(np.float32) for kind in KEPT for name in (kind, f"{kind}_mean")}


def _layers(inputs: int, one: int, two: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(2 * inputs + OUTPUTS + 1, one), nn.ReLU(), nn.Dropout(0.2),
        nn.Linear(one, two), nn.ReLU(), nn.Linear(two, outputs),
    )  # fmt: skip


class RigNet(nn.Module):
    """Components and the reference's, what is known of that, and whether there is one -> coefficients, gaze (n, 46).

    The coefficients are told from all but the irises, the gaze from all but the mouth.
    """

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.face = _layers(inputs - IRISES, *WIDTHS, OUTPUTS - 2)
        self.look = _layers(inputs - KEPT["mouth"], *LOOK_WIDTHS, 2)

    def forward(self, own: Tensor, other: Tensor, known: Tensor, given: Tensor) -> Tensor:
        away, rest = (own - other) * given, (known * given, given)
        face = self.face(torch.cat([own[:, :-IRISES], away[:, :-IRISES], *rest], 1))
        look = self.look(torch.cat([own[:, KEPT["mouth"] :], away[:, KEPT["mouth"] :], *rest], 1))
        return torch.cat([face, look], 1)


def _some(rng: np.random.Generator, groups: list[Int], count: int) -> list[Int]:
    return [groups[k] for k in rng.choice(len(groups), min(count, len(groups)), replace=False)]


def _batch(data: Sights, rng: np.random.Generator) -> tuple[Int, Int, Tensor]:
    """Rows, the row that is the reference of each, and the number of the sitting of each."""
    rows, others, sittings = [], [], []
    pools = ((data.rendered, GROUPS), (data.real, REAL_GROUPS), (data.stills, STILL_GROUPS))
    picked = [one for groups, count in pools for one in _some(rng, groups, count)]
    for number, one in enumerate(picked):
        group = rng.permutation(one)[:PER_GROUP]
        calm = group[np.argmin(np.abs(data.truth[group, :-2]).sum(1))]
        others.append(np.where(rng.random(len(group)) < CALM, calm, rng.choice(group, len(group))))
        rows.append(group)
        sittings.append(np.full(len(group), number))
    return np.concatenate(rows), np.concatenate(others), torch.from_numpy(np.concatenate(sittings))


def _unlike(found: Tensor, truth: Tensor, sittings: Tensor) -> Tensor:
    """How far within each sitting (n,) what moves is from moving in step, so that small moves count like large ones."""
    count = int(sittings.max()) + 1

    def averaged(values: Tensor) -> Tensor:
        added = torch.zeros(count, values.shape[1]).index_add_(0, sittings, values)
        return added / torch.bincount(sittings)[:, None]

    a, b = (values - averaged(values)[sittings] for values in (found, truth))
    spread = averaged(b * b)
    alike = averaged(a * b) / torch.sqrt((averaged(a * a) + 1e-4) * (spread + 1e-6))
    weight = (spread.sqrt() > MOVES) * spread.sqrt().clamp(max=CLEARLY)
    return ((1 - alike) * weight).sum() / weight.sum().clamp(min=1)


def _loss(found: Tensor, truth: Tensor, importance: Tensor) -> Tensor:
    each = F.smooth_l1_loss(found, truth, reduction="none", beta=0.1)
    shut = truth[:, [NAMES.index("eyeBlinkLeft"), NAMES.index("eyeBlinkRight")]].mean(1, keepdim=True)
    look = (1 - shut).clamp(0, 1) ** 2  # shut eyes do not look
    return torch.cat([each[:, :-2], each[:, -2:] * look * 1.5], 1).mul(importance).mean()


@torch.no_grad()
def figures(net: nn.Module, data: Sights, seen: Tensor, truth: Tensor, alone: bool) -> dict[str, float]:
    """Correlations of what is told with the truth, of people held out."""
    net.eval()
    found, true = [], []
    for rows in data.groups:
        calm = rows[np.argmin(np.abs(data.truth[rows, :-2]).sum(1))]
        others = np.full(len(rows), calm)
        given = torch.full((len(rows), 1), 0.0 if alone else 1.0)
        found.append(net(seen[0, rows], seen[0, others], truth[0, others], given))
        true.append(truth[0, rows])
    a, b = torch.cat(found).numpy(), torch.cat(true).numpy()
    names = [*NAMES, *LOOKS]
    return {
        n: float(np.corrcoef(a[:, k], b[:, k])[0, 1]) for k, n in enumerate(names) if b[:, k].std() > 0.02
    }


SHOWN = {
    "blink": ("eyeBlinkLeft", "eyeBlinkRight"), "smile": ("mouthSmileLeft", "mouthSmileRight"), "jaw": ("jawOpen",),
    "pucker": ("mouthPucker",), "up": ("browInnerUp", "browOuterUpLeft", "browOuterUpRight"),
    "down": ("browDownLeft", "browDownRight"), "gaze": LOOKS,
}  # fmt: skip


def save(path: Path, basis: dict[str, F32], net: RigNet) -> None:
    """Write what `guise.aam.rig.coefficients` reads, in float16; weights of each of the networks, (1, ...) here."""
    arrays = dict(basis)
    for name in ("face", "look"):
        for k, layer in enumerate(one for one in getattr(net, name) if isinstance(one, nn.Linear)):
            arrays |= {
                f"{name}_weight{k}": layer.weight.detach().numpy().T[None],
                f"{name}_bias{k}": layer.bias.detach().numpy()[None, None],
            }
    np.savez_compressed(path, **{name: values.astype(np.float16) for name, values in arrays.items()})  # type: ignore[arg-type]


def join(networks: list[Path], path: Path) -> None:
    """Write networks of one basis as one that tells their mean."""
    stored = [dict(np.load(file)) for file in networks]
    joined = {
        name: values
        if "_mean" in name or name in KEPT
        else np.concatenate([one[name].reshape(-1, *values.shape[1:]) for one in stored])
        for name, values in stored[0].items()
    }
    np.savez_compressed(path, **joined)


def train(options: argparse.Namespace) -> None:
    """Learn, and write the figures of people held out every minute."""
    rng = np.random.default_rng(options.seed)
    data, held = Sights(options.sights, 0, 9), Sights(options.sights, 9, 10)
    basis = basis_of(data) if options.basis is None else stored_basis(options.basis)
    (seen, truth), (held_seen, held_truth) = data.components(basis), held.components(basis)
    print(seen.shape, held_seen.shape, flush=True)
    net = RigNet(seen.shape[2])
    average = torch.optim.swa_utils.AveragedModel(
        net, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(0.995)
    )
    optimiser = torch.optim.AdamW(net.parameters(), lr=options.rate, weight_decay=0.03)
    importance = 1 / (truth[0].std(0) + 0.06)
    losses = list[float]()
    for step in range(options.steps):
        for group in optimiser.param_groups:
            group["lr"] = (
                options.rate * min(1, step / 50) * 0.5 * (1 + math.cos(math.pi * step / options.steps))
            )
        rows, others, sittings = _batch(data, rng)
        way = int(rng.integers(2))
        own, other = seen[way, rows], seen[way, others]
        own, other = (x + 0.1 * torch.randn_like(x) for x in (own, other))
        given = torch.from_numpy((rng.random((len(rows), 1)) > ALONE).astype(np.float32))
        net.train()
        found, true = net(own, other, truth[way, others], given), truth[way, rows]
        loss = _loss(found, true, importance) + options.alike * _unlike(found, true, sittings)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        average.update_parameters(net)
        losses.append(float(loss.detach()))
        if step % 350 == 349 or step == options.steps - 1:
            row = {"step": step + 1, "loss": float(np.mean(losses[-200:]))}
            for kind, alone in (("", False), ("alone_", True)):
                scores = figures(average.module, held, held_seen, held_truth, alone)
                row |= {
                    f"{kind}{k}": float(np.mean([scores[n] for n in names if n in scores]))
                    for k, names in SHOWN.items()
                }
                row[f"{kind}all"] = float(np.mean(list(scores.values())))
            print(" ".join(f"{k}={v:.3f}" for k, v in row.items()), flush=True)
            save(options.output, basis, copy.deepcopy(average.module))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    ways = parser.add_subparsers(dest="way", required=True)
    one, many = ways.add_parser("train"), ways.add_parser("join")
    one.add_argument("--sights", type=Path, nargs="+", required=True)
    one.add_argument("--basis", type=Path)
    one.add_argument("--steps", type=int, default=1500)
    one.add_argument("--rate", type=float, default=2e-3)
    one.add_argument("--seed", type=int, default=1)
    one.add_argument("--alike", type=float, default=0.0, help="weight of the correlation within a sitting")
    many.add_argument("networks", type=Path, nargs="+")
    for each in (one, many):
        each.add_argument("--output", type=Path, required=True)
    options = parser.parse_args()
    if options.way == "join":
        return join(options.networks, options.output)
    torch.set_num_threads(1)
    torch.manual_seed(options.seed)
    return train(options)


if __name__ == "__main__":
    main()
