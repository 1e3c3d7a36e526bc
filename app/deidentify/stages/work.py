"""The work folder of a file: its manifest and the results of finished jobs, each written whole or not at all.

It lies beside the output as OUTPUT.work, readable by its owner only, because it holds faces.  It is deleted when the
output is complete, and kept after a failure, so that the run can be resumed.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.common.files import write_whole

MANIFEST = "manifest.json"


@dataclass(frozen=True)
class WorkFolder:
    """A work folder."""

    folder: Path

    def path(self, name: str) -> Path:
        """The file of a result."""
        return self.folder / name

    def has(self, name: str) -> bool:
        """Whether a result is there."""
        return self.path(name).exists()

    def save_json(self, name: str, value: Any) -> None:
        """Write a JSON result."""
        text = json.dumps(value)
        write_whole(self.path(name), text)

    def load_json(self, name: str) -> Any:
        """Read a JSON result."""
        return json.loads(self.path(name).read_text(encoding="utf-8"))

    def save_arrays(self, name: str, **arrays: NDArray[Any]) -> None:
        """Write arrays."""

        def write(part: Path) -> None:
            with part.open("wb") as file:
                np.savez(file, allow_pickle=False, **arrays)

        write_whole(self.path(name), write)

    def load_arrays(self, name: str, but: str = "") -> dict[str, NDArray[Any]]:
        """Read arrays, all `but` one."""
        with np.load(self.path(name), allow_pickle=False) as file:
            return {key: file[key] for key in file.files if key != but}

    def forget(self, *patterns: str) -> None:
        """Delete results, so that they are made again."""
        for pattern in patterns:
            for file in self.folder.glob(pattern):
                file.unlink()

    def create(self) -> None:
        """Make the folder, empty, for its owner only."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(mode=0o700)

    def remove(self) -> None:
        """Delete the folder and all in it."""
        shutil.rmtree(self.folder, ignore_errors=True)
