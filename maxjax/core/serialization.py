"""Checked, atomic files: pytrees as .npz, and the one way in which maxjax writes any file.

A pytree file is a plain .npz archive. Each leaf is an array named by its key path
(`tree['encoder'][0].kernel`); the entry `header` is JSON that holds the caller's metadata and

    sha256 = SHA-256 over, for every leaf in order: name, dtype, shape, bytes; then the metadata.

Reading trusts nothing: sizes are checked against the archive's directory before memory is taken, no pickle is
ever opened, the hash is recomputed, and every leaf must match the structure that the caller expects.
Writing goes to a temporary file in the same folder, is flushed to the disk and then renamed, so that a reader
sees the old file or the new one and never a part.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from maxjax.core.files import FileError, atomic_write, brief, open_regular

T = TypeVar("T")

_FORMAT = "maxjax pytree 1"
_HEADER = "header"
_MAX_BYTES = 2**31


def save_pytree(path: str | os.PathLike[str], tree: Any, *, metadata: Mapping[str, Any] | None = None) -> None:
    """Save the leaves of a pytree, under their key paths, as a checked .npz file.

    Equal trees give equal files.

    Args:
        path: file to write, atomically.
        tree: pytree of arrays and Python numbers; at least one leaf.
        metadata: anything that JSON can hold, for `load_metadata`.

    Raises:
        ValueError: for a leaf that is not a plain numeric or boolean array, or metadata that JSON cannot
            hold.
        OSError: if the file cannot be written.
    """
    leaves = {}
    for key, leaf in jax.tree_util.tree_flatten_with_path(tree)[0]:
        name = _name(key)
        if name in leaves:
            raise ValueError(f"{path}: two leaves share the key path {name}; give them different keys")
        leaves[name] = _as_array(name, leaf)
    if not leaves:
        raise ValueError(f"{path}: expected a tree with at least one array, given one without leaves")
    try:
        # The round trip makes what is hashed here equal to what is read back (tuples become lists, say).
        noted = json.loads(json.dumps(dict(metadata or {})))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: expected metadata that JSON can hold, given {metadata!r}: {error}") from error
    header = {"format": _FORMAT, "sha256": _digest(leaves, noted), "metadata": noted}
    encoded = np.frombuffer(json.dumps(header).encode(), np.uint8)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as entries:
        for name, array in {_HEADER: encoded, **leaves}.items():
            # A ZipInfo of its own carries no date, so that equal trees give equal bytes.
            with entries.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)
    atomic_write(path, archive.getvalue())


def load_pytree(path: str | os.PathLike[str], like: T) -> T:
    """Restore what `save_pytree` wrote into the structure of `like`.

    Args:
        path: file to read.
        like: pytree with the expected structure, shapes and dtypes: an example, or what `jax.eval_shape`
            returns. Its values are not used, but what is static in it (and so in no file) is kept.

    Returns:
        A tree like `like`: JAX arrays where it holds JAX arrays, Python numbers where it holds Python
        numbers, NumPy arrays elsewhere.

    Raises:
        ValueError: if the file is missing, unreadable or altered, or if its key paths, shapes or dtypes
            differ.
    """
    leaves, _ = _load(path)
    wanted, structure = jax.tree_util.tree_flatten_with_path(like)
    names = [_name(key) for key, _ in wanted]
    missing, extra = sorted(set(names) - set(leaves)), sorted(set(leaves) - set(names))
    if missing or extra:
        raise ValueError(
            f"{path}: holds another tree: lacks {_some(missing)}, has unexpected {_some(extra)}; "
            "load it with the configuration that it was saved with"
        )
    restored: list[Any] = []
    for name, (_, leaf) in zip(names, wanted, strict=True):
        array = leaves[name]
        expected = leaf if hasattr(leaf, "dtype") else np.asarray(leaf)
        if array.shape != tuple(expected.shape) or array.dtype != expected.dtype:
            raise ValueError(
                f"{path}: {name}: expected {expected.dtype}{list(expected.shape)}, "
                f"given {array.dtype}{list(array.shape)}"
            )
        if isinstance(leaf, jax.Array):
            restored.append(jnp.asarray(array))
        elif isinstance(leaf, np.generic):
            restored.append(array[()])
        else:
            restored.append(array if hasattr(leaf, "dtype") else array.item())
    tree: T = jax.tree_util.tree_unflatten(structure, restored)
    return tree


def load_metadata(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The metadata of a file that `save_pytree` wrote; the whole file is checked against its hash.

    Raises:
        ValueError: if the file is missing, unreadable or altered.
    """
    return _load(path)[1]


def read_npz(path: str | os.PathLike[str], *, max_bytes: int = _MAX_BYTES) -> dict[str, np.ndarray]:
    """All arrays of an .npz file from anywhere, without trusting it.

    Args:
        path: file to read.
        max_bytes: most that all its arrays together may take, unpacked; checked before anything is unpacked.

    Raises:
        ValueError: if the file is missing, no regular file, not an .npz archive, truncated or altered, holds pickled
            objects, claims sizes that it does not have, or unpacks to more than `max_bytes`.
    """
    arrays = {}
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            total = sum(info.file_size for info in archive.infolist())
            if total > max_bytes:
                raise ValueError(f"unpacks to {total} bytes, expected at most {max_bytes}; crop or split it")
            for info in archive.infolist():
                arrays[info.filename.removesuffix(".npy")] = _read_entry(archive, info)
    except FileError:
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError, struct.error, RuntimeError, MemoryError) as error:
        # RuntimeError: zipfile's word for an encrypted entry.
        raise ValueError(
            f"{path}: expected an intact .npz archive, given a damaged or foreign file: {brief(error)}"
        ) from error
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"{path}: {brief(error)}") from error
    return arrays


def _read_entry(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """One array. Its own header's claim is checked against the archive's directory before memory is taken."""
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{info.filename}: expected plain or deflated data, as NumPy writes it")
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    with archive.open(info) as entry:
        version = np.lib.format.read_magic(entry)
        if version not in readers:
            raise ValueError(f"{info.filename}: expected .npy version 1.0 or 2.0, given {version}")
        shape, fortran, dtype = readers[version](entry)
        if dtype.hasobject:
            raise ValueError(f"{info.filename}: holds pickled objects, expected numbers; they are never opened")
        expected, given = math.prod(shape) * dtype.itemsize, info.file_size - entry.tell()
        if expected != given or min(shape, default=0) < 0:
            raise ValueError(
                f"{info.filename}: {dtype}{list(shape)} takes {expected} bytes, the archive holds {given}; "
                "the file is damaged"
            )
        # Reading to the end makes zipfile compare the entry's checksum.
        return np.ndarray(shape, dtype, buffer=bytearray(entry.read()), order="F" if fortran else "C")


def _load(path: str | os.PathLike[str]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Leaves by name, and metadata, of a pytree file whose hash is right."""
    leaves = read_npz(path)
    try:
        header = json.loads(leaves.pop(_HEADER).tobytes())
        known, digest, metadata = header["format"] == _FORMAT, header["sha256"], header["metadata"]
        if not isinstance(metadata, dict):
            raise TypeError(f"metadata: expected a table, given {brief(metadata)}")
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(
            f"{path}: expected a file written by save_pytree, given an archive without its header"
        ) from error
    if not known:
        raise ValueError(f"{path}: expected format {_FORMAT!r}, given {brief(header['format'])!r}")
    given = _digest(leaves, metadata)
    if given != digest:
        raise ValueError(
            f"{path}: contents were altered: expected SHA-256 {brief(digest)}, given {given}; fetch it again"
        )
    return leaves, metadata


def _digest(leaves: Mapping[str, np.ndarray], metadata: Any) -> str:
    """SHA-256 over names, dtypes, shapes, bytes in order, then the metadata; each part after its length."""
    digest = hashlib.sha256()
    for name, array in leaves.items():
        for part in (name.encode(), array.dtype.str.encode(), repr(array.shape).encode(), array.tobytes()):
            digest.update(len(part).to_bytes(8, "little"))
            digest.update(part)
    digest.update(json.dumps(metadata, sort_keys=True).encode())
    return digest.hexdigest()


def _name(key: tuple[Any, ...]) -> str:
    """Name of a leaf: its key path, written as Python would reach it from `tree`."""
    return "tree" + jax.tree_util.keystr(key)


def _as_array(name: str, leaf: Any) -> np.ndarray:
    """A leaf on the host, if it is made of plain numbers."""
    dtype = getattr(leaf, "dtype", None) if hasattr(leaf, "dtype") else np.asarray(leaf).dtype
    if not isinstance(dtype, np.dtype) or dtype.kind not in "biufc" or dtype.isbuiltin != 1:
        raise ValueError(
            f"{name}: expected a real, complex, integer or boolean array of a NumPy dtype, given {dtype}; "
            "convert it first (bfloat16 to float32, random keys by jax.random.key_data)"
        )
    return np.asarray(leaf)


def _some(names: list[str]) -> str:
    """A list short enough for a sentence."""
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "") if names else "nothing"
