"""Compiled once a machine: jitted functions whose executables are kept on disk.

    arguments → key → executable of this process | of an earlier one | traced, lowered, compiled, and kept

JAX's own cache is asked only after a function was traced and lowered, which takes longer than to run it. The key here
is made of all that both depend on: the sources of maxjax, shapes, dtypes and structure of the arguments, the static
ones, versions and settings of JAX, flags of the compiler; and the folder is the machine's (`compile.cache`). What
cannot be put into words, a function from elsewhere for one, is not kept.

Executables of CPUs are kept. For an accelerator JAX's own cache is switched on. Where the user has switched it on,
nothing is kept here: an executable that was read from there lacks functions when it is written once more.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import functools
import hashlib
import os
import pickle
import sys
import weakref
import zlib
from collections.abc import Callable, Hashable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

import jax
import numpy as np
from jax.experimental import serialize_executable

from maxjax.compile.cache import cache_folder, let_jax_keep, trim
from maxjax.compile.compilation import compiling
from maxjax.compile.false_alarm import without_false_alarm
from maxjax.compile.forked import refuse_after_fork
from maxjax.compile.lowering import target
from maxjax.core.files import atomic_write
from maxjax.core.provenance import sources

P = ParamSpec("P")
R = TypeVar("R")

_FORMAT = "maxjax executable 2"


class Stored(Generic[P, R]):
    """A jitted function that is compiled once a machine; one executable for each combination of what it depends on.

    Positional arguments are pytrees of arrays and numbers, keywords are static.

    Attributes:
        name: told while it compiles.
    """

    def __init__(self, name: str, function: Callable[P, R], static: tuple[str, ...] = ()) -> None:
        functools.update_wrapper(self, function)
        self.name = name
        self._function, self._static = function, static
        self._ready: dict[Hashable, Callable[..., R]] = {}
        # What compiles: several devices that do so at a time share a trace. Later ones are rare, and traces are large.
        self._compiling: weakref.WeakValueDictionary[Hashable, Any] = weakref.WeakValueDictionary()

    def __call__(self, *arrays: P.args, **static: P.kwargs) -> R:
        """The function's value; within another program that is traced, a part of it."""
        if any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(arrays)):
            return self._function(*arrays, **static)
        return self.executable(arrays, static)(*arrays)

    def executable(
        self,
        arrays: tuple[Any, ...],
        static: Mapping[str, Any],
        around: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
    ) -> Callable[..., R]:
        """The executable for such arguments.

        Args:
            arrays, static: of a call.
            around: a context for what it takes the first time in a process.

        Raises:
            RuntimeError: in a process that was forked after JAX had run.
        """
        refuse_after_fork()
        leaves, tree = jax.tree.flatten(arrays)
        placed = {device for x in leaves if isinstance(x, jax.Array) and x.committed for device in x.devices()}
        given = tuple(map(_abstract, leaves))
        key = (tree, given, tuple(sorted(static.items())), frozenset(placed - {jax.local_devices()[0]}))
        if key not in self._ready:
            if unknown := set(static) - set(self._static):
                raise TypeError(f"{self.name}: expected keywords among {self._static}, given {sorted(unknown)}")
            with around():
                of_leaves = self._obtained(leaves, tree, static)
            self._ready[key] = lambda *arrays: of_leaves(*jax.tree.leaves(arrays))
        return self._ready[key]

    def _obtained(self, leaves: list[Any], tree: Any, static: Mapping[str, Any]) -> Callable[..., R]:
        """Of leaves; read from disk, or compiled and written there."""
        file = self._file(leaves, tree, static)
        if file is not None and (found := _read(file, len(leaves))) is not None:
            return found
        if target() != "cpu":
            let_jax_keep()

        def of_leaves(*leaves: Any) -> R:
            return self._function(*jax.tree.unflatten(tree, leaves), **static)

        of_leaves.__name__ = getattr(self._function, "__name__", self.name)  # as JAX's logs have it
        jitted = self._compiling.setdefault((tree, tuple(sorted(static.items()))), jax.jit(of_leaves))
        with compiling(self.name):
            compiled = jitted.lower(*leaves).compile()
        if file is not None:
            _write(file, compiled)
        ready: Callable[..., R] = compiled
        return ready

    def _file(self, leaves: list[Any], tree: Any, static: Mapping[str, Any]) -> Path | None:
        """Where the executable is kept; None where it is not."""
        folder = cache_folder()
        home = jax.local_devices()[0]
        if folder is None or home.platform != "cpu" or target() != "cpu":
            return None
        if jax.config.values["jax_compilation_cache_dir"] or jax.config.values["jax_default_device"]:
            return None
        if any(isinstance(x, jax.Array) and x.devices() != {home} for x in leaves):
            return None
        try:
            words = [_surroundings(), _words(self._function), _words(dict(static)), _structure(tree)]
        except _UnnamedError:
            return None
        digest = hashlib.sha256("\n".join([*words, *map(str, map(_abstract, leaves))]).encode()).hexdigest()
        return folder / f"{self.name.replace(' ', '-')}-{digest}"


def stored(name: str, static: tuple[str, ...] = ()) -> Callable[[Callable[P, R]], Stored[P, R]]:
    """`Stored` as a decorator."""
    return lambda function: Stored(name, function, static)


def _abstract(leaf: Any) -> tuple[tuple[int, ...], str, bool]:
    """Shape and type of an argument; a number of Python takes the type of what it meets."""
    if isinstance(leaf, bool | int | float | complex):
        return (), type(leaf).__name__, True
    return np.shape(leaf), str(leaf.dtype), bool(getattr(leaf, "weak_type", False))


def _read(file: Path, count: int) -> Callable[..., Any] | None:
    """The executable in a file, a function of so many leaves; None where there is none, or none that can be read."""
    try:
        stated, content = file.read_bytes().split(b"\n", 1)
        if stated != _seal(file, content):
            return None
        payload, out_tree = pickle.loads(zlib.decompress(content))
        home = jax.local_devices()[:1]
        with without_false_alarm():
            found: Callable[..., Any] = serialize_executable.deserialize_and_load(
                payload, jax.tree.structure(((0,) * count, {})), out_tree, execution_devices=home
            )
        return found
    except FileNotFoundError:
        return None
    except Exception:  # whatever is wrong with a file or with what JAX makes of it: compiling repairs it
        return None


def _write(file: Path, compiled: jax.stages.Compiled) -> None:
    # Nothing is lost but time where JAX cannot serialise an executable, or the disk is full.
    with contextlib.suppress(Exception):
        payload, _, out_tree = serialize_executable.serialize(compiled)
        content = zlib.compress(pickle.dumps((payload, out_tree)), 1)
        atomic_write(file, _seal(file, content) + b"\n" + content)
        trim(file.parent)


def _seal(file: Path, content: bytes) -> bytes:
    """Head of an entry: its program, which the file's name tells, and its content have this digest alone.

    A file that was copied over another's name, or damaged, is so compiled anew. It is no protection from who may write
    into the folder.
    """
    return hashlib.sha256(file.name.encode() + b"\n" + content).hexdigest().encode()


class _UnnamedError(Exception):
    """A value that words do not describe."""


def _words(value: Any) -> str:
    """A text that two values share only if a program is the same for both."""
    if value is None or isinstance(value, bool | int | float | str | np.dtype | np.generic) or value is ...:
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, enum.Enum):
        return f"{_words(type(value))} {value.name}"
    if isinstance(value, np.ndarray | jax.Array):
        array = np.asarray(value)
        return f"array {array.shape} {array.dtype} {hashlib.sha256(array.tobytes()).hexdigest()}"
    if isinstance(value, tuple | list):
        return f"{type(value).__name__} [{', '.join(map(_words, value))}]"
    if isinstance(value, Mapping):
        return f"mapping [{', '.join(sorted(f'{_words(key)}: {_words(item)}' for key, item in value.items()))}]"
    if isinstance(value, functools.partial):
        return f"partial {_words((value.func, value.args, value.keywords))}"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return f"{_words(type(value))} {_words(fields)}"
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    # What maxjax or Python names on the level of a module is told by its sources.
    named = isinstance(module, str) and isinstance(name, str) and "<" not in name
    if named and str(module).partition(".")[0] in ("maxjax", "builtins"):
        return f"{module}.{name}"
    raise _UnnamedError(value)


def _structure(tree: Any) -> str:
    """A pytree's structure, with what its classes hold that is no leaf."""
    node = tree.node_data()
    if node is None:
        return "leaf" if tree.num_leaves else "none"
    kind, held = node
    return f"{_words(kind)} {_words(held)} ({', '.join(map(_structure, tree.children()))})"


def _surroundings() -> str:
    """Other inputs of tracing and compiling."""
    settings = sorted((k, repr(v)) for k, v in jax.config.values.items() if "cache" not in k and "log_" not in k)
    found = [_FORMAT, sources(), *_versions(), repr(settings), os.environ.get("XLA_FLAGS", "")]
    return "\n".join([*found, repr([argument for argument in sys.argv if argument.startswith("--xla")])])


@functools.cache
def _versions() -> tuple[str, str]:
    return version("jax"), version("jaxlib")
