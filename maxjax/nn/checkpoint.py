"""Checkpoints: a pytree in several files, and a manifest that names them.

    checkpoint.json   { files: [ { name, sha256 } ], metadata }        state-STEP-PART.npz   leaves
    (`core.serialization`)

The manifest is written last, atomically, and the files of the checkpoint before it are removed after that: whatever
happens in between, a full disk or a kill, the manifest on the disk names a whole checkpoint. Several files, because a
network's state is three times its weights, and some ways out of a machine carry small files only.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np

from maxjax.core.files import atomic_write, brief, read_bytes, read_text
from maxjax.core.serialization import load_pytree, save_pytree

T = TypeVar("T")

MANIFEST = "checkpoint.json"
_LIMIT = 12 * 2**20  # [bytes] of leaves in a file, unless one leaf alone is larger


def save_checkpoint(folder: str | os.PathLike[str], tree: Any, step: int, metadata: Mapping[str, Any]) -> None:
    """Replace the checkpoint in a folder.

    Args:
        folder: made if missing.
        tree: pytree of arrays.
        step: names the files; another one than that of the checkpoint before.
        metadata: anything that JSON can hold.

    Raises:
        OSError: if it cannot be written; the checkpoint before stays.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    try:
        for number, part in enumerate(_parts(jax.tree.leaves(tree))):
            paths.append(folder / f"state-{step:08d}-{number}.npz")
            save_pytree(paths[-1], part)
        files = [{"name": path.name, "sha256": _digest(path)} for path in paths]
        atomic_write(folder / MANIFEST, json.dumps({"files": files, "metadata": dict(metadata)}, indent=2) + "\n")
    except BaseException:
        for path in paths:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
        raise
    for old in set(folder.glob("state-*.npz")) - set(paths):
        old.unlink(missing_ok=True)


def load_metadata(folder: str | os.PathLike[str]) -> dict[str, Any] | None:
    """The metadata of the checkpoint in a folder; None if it has none.

    Raises:
        ValueError: for a manifest that cannot be read.
    """
    manifest = _manifest(Path(folder))
    return None if manifest is None else manifest["metadata"]


def load_checkpoint(folder: str | os.PathLike[str], like: T) -> T:
    """Restore a checkpoint, bit for bit.

    Args:
        folder: where `save_checkpoint` wrote.
        like: pytree with the expected structure, shapes and dtypes.

    Raises:
        ValueError: if there is none, a file is missing, cut short or altered, or it holds another tree.
    """
    folder = Path(folder)
    manifest = _manifest(folder)
    if manifest is None:
        raise ValueError(f"{folder}: expected a checkpoint, found no {MANIFEST}")
    leaves, structure = jax.tree.flatten(like)
    parts = list(_parts(leaves))
    if len(parts) != len(manifest["files"]):
        raise ValueError(f"{folder}: expected a checkpoint of {len(parts)} files, given {len(manifest['files'])}")
    restored: dict[str, Any] = {}
    for part, file in zip(parts, manifest["files"], strict=True):
        path = folder / file["name"]
        given = _digest(path)
        if given != file["sha256"]:
            raise ValueError(f"{path}: contents were altered: expected SHA-256 {brief(file['sha256'])}, given {given}")
        restored |= load_pytree(path, part)
    tree: T = jax.tree.unflatten(structure, [restored[_key(number)] for number in range(len(leaves))])
    return tree


def _parts(leaves: list[Any]) -> list[dict[str, Any]]:
    """Leaves by number, in files of at most `_LIMIT`."""
    parts: list[dict[str, Any]] = [{}]
    room = _LIMIT
    for number, leaf in enumerate(leaves):
        size = int(np.prod(leaf.shape)) * leaf.dtype.itemsize
        if size > room and parts[-1]:
            parts.append({})
            room = _LIMIT
        parts[-1][_key(number)] = leaf
        room -= size
    return parts


def _key(number: int) -> str:
    return f"{number:05d}"


def _manifest(folder: Path) -> dict[str, Any] | None:
    path = folder / MANIFEST
    if not path.exists():
        return None
    text = read_text(path)
    try:
        found = json.loads(text)
        files = [{"name": Path(file["name"]).name, "sha256": str(file["sha256"])} for file in found["files"]]
        return {"files": files, "metadata": dict(found["metadata"])}
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise ValueError(f"{path}: expected a checkpoint's manifest, given something else") from error


def _digest(path: Path) -> str:
    return hashlib.sha256(read_bytes(path)).hexdigest()
