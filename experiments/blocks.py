"""Blocks of a long run, kept on the disk: a run that was ended goes on with the first one that is missing.

    FOLDER/BLOCK.json = {"run": what the blocks of one run share, "block": what was found}

A file is written whole or not at all, and removed with its folder once the run has its result.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maxjax.core.files import atomic_write


@dataclasses.dataclass(frozen=True)
class Blocks:
    """The blocks of one run.

    Attributes:
        folder: where they lie; made with the first one.
        run: what tells runs apart, as JSON holds it: commit and settings.
    """

    folder: Path
    run: Mapping[str, Any]

    def kept(self, name: str) -> Any:
        """What was found in a block; None where it is missing.

        Raises:
            ValueError: for a block of another run.
        """
        file = self.folder / f"{name}.json"
        if not file.is_file():
            return None
        document = json.loads(file.read_text())
        ours = json.loads(json.dumps(self.run))
        other = [key for key in ours if document["run"].get(key) != ours[key]]
        if other:
            told = "; ".join(f"{key} was {document['run'].get(key)!r} there, is {ours[key]!r} here" for key in other)
            raise ValueError(f"{file}: a block of another run: {told}; finish that run, or delete {self.folder}")
        return document["block"]

    def keep(self, name: str, block: Any) -> None:
        """Write what was found in a block; JSON's numbers, NaN and infinities among them."""
        self.folder.mkdir(parents=True, exist_ok=True)
        atomic_write(self.folder / f"{name}.json", json.dumps({"run": self.run, "block": block}, default=_plain))

    def remove(self) -> None:
        """Delete all blocks."""
        shutil.rmtree(self.folder, ignore_errors=True)


def _plain(number: Any) -> Any:
    """Python's number for NumPy's."""
    return number.item()
