"""Executables on disk: a later process neither traces nor compiles, and gets the same values."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache

from maxjax.compile import cache, executable
from maxjax.compile.executable import Stored, stored
from maxjax.compile.threads import concurrently
from maxjax.core.grid import Grid
from maxjax.fields.conductivity import conductivity
from maxjax.fields.occupancy import squared_distance
from maxjax.planning.problem.distances import Distances
from maxjax.sim.worlds import scenes
from maxjax.sim.worlds.scenes import make_scene

MAP = np.zeros((5, 6, 7), bool)
MAP[2, 3, 4] = True


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder, JAX's own cache switched off."""
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path))
    found = cache.cache_folder()
    assert found is not None
    of_jax = jax.config.values["jax_compilation_cache_dir"]
    _let_jax_keep_in(None)
    yield found
    _let_jax_keep_in(of_jax)


def _let_jax_keep_in(folder: str | None) -> None:
    jax.config.update("jax_compilation_cache_dir", folder)
    compilation_cache.reset_cache()


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the programs that were compiled."""
    names: list[str] = []
    real = executable.compiling

    def compiling(name: str) -> Any:
        names.append(name)
        return real(name)

    monkeypatch.setattr(executable, "compiling", compiling)
    return names


def distance_program() -> Stored[..., Any]:
    """As a new process makes it."""
    return Stored("distance", squared_distance, static=("reach",))


def test_a_later_process_reads_what_an_earlier_one_compiled(folder: Path, compiled: list[str]) -> None:
    expected = squared_distance(jnp.asarray(MAP), 2)
    first, second = distance_program(), distance_program()
    np.testing.assert_array_equal(first(MAP, reach=2), expected)
    assert len(list(folder.glob("distance-*"))) == 1
    np.testing.assert_array_equal(first(MAP, reach=2), expected)
    np.testing.assert_array_equal(second(jnp.asarray(MAP), reach=2), expected)
    assert compiled == ["distance"]


def test_within_another_program_it_is_a_part_of_it(folder: Path, compiled: list[str]) -> None:
    def distance(occupied: Any) -> Any:
        return distance_program()(occupied, reach=2)

    several = jax.jit(jax.vmap(distance))(np.stack([MAP, MAP[::-1]]))
    np.testing.assert_array_equal(several[0], squared_distance(jnp.asarray(MAP), 2))
    assert not compiled


def test_pytrees_go_in_and_come_out(folder: Path, compiled: list[str]) -> None:
    cities = []
    for _ in range(2):
        executable_of_city = stored("city", static=("name",))(scenes._built.__wrapped__)
        cities.append(executable_of_city(np.uint32(3), name="suburb"))
    assert compiled == ["city"]
    first, second = cities
    assert first.type == second.type == make_scene("suburb", 3).geoms.type
    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_a_program_depends_on_has_a_file_of_its_own(
    folder: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    distance_program()(MAP, reach=2)
    distance_program()(MAP, reach=3)
    distance_program()(MAP[:4], reach=2)
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_enable_fast_math=false")
    distance_program()(MAP, reach=2)
    monkeypatch.setattr(executable, "sources", lambda: "a later version")
    distance_program()(MAP, reach=2)
    before = jax.config.values["jax_disable_most_optimizations"]
    jax.config.update("jax_disable_most_optimizations", not before)
    try:
        distance_program()(MAP, reach=2)
    finally:
        jax.config.update("jax_disable_most_optimizations", before)
    assert len(compiled) == len(list(folder.glob("distance-*"))) == 6


@pytest.mark.parametrize("content", [b"", b"no executable", bytes(1000)])
def test_a_damaged_file_is_compiled_anew(content: bytes, folder: Path, compiled: list[str]) -> None:
    distance_program()(MAP, reach=2)
    (file,) = folder.glob("distance-*")
    whole = file.read_bytes()
    for damaged in (content, whole[: len(whole) // 2]):
        file.write_bytes(damaged)
        np.testing.assert_array_equal(distance_program()(MAP, reach=2), squared_distance(jnp.asarray(MAP), 2))
    assert compiled == ["distance"] * 3
    distance_program()(MAP, reach=2)
    assert len(compiled) == 3


def test_the_entry_of_another_program_under_a_right_name_is_compiled_anew(folder: Path, compiled: list[str]) -> None:
    distance_program()(MAP, reach=2)
    (right,) = folder.glob("distance-*")
    distance_program()(MAP[:4], reach=2)
    (other,) = set(folder.glob("distance-*")) - {right}
    right.write_bytes(other.read_bytes())
    np.testing.assert_array_equal(distance_program()(MAP, reach=2), squared_distance(jnp.asarray(MAP), 2))
    assert len(compiled) == 3


def twice(x: Any) -> Any:
    return 2 * x


def test_functions_from_elsewhere_run_and_are_not_kept(folder: Path) -> None:
    assert float(Stored("twice", twice)(np.float32(3))) == 6
    assert float(Stored("twice", lambda x: 2 * x)(np.float32(3))) == 6
    given = Stored("applied", _applied, static=("function",))
    assert float(given(np.float32(3), function=twice)) == 6
    assert not list(folder.glob("*-*"))


def _applied(x: Any, function: Any) -> Any:
    return function(x)


def test_nothing_is_kept_twice(folder: Path, compiled: list[str], tmp_path: Path) -> None:
    """What JAX has read from its own cache cannot be written again."""
    _let_jax_keep_in(str(tmp_path / "jax"))
    for _ in range(2):
        np.testing.assert_array_equal(distance_program()(MAP, reach=2), squared_distance(jnp.asarray(MAP), 2))
    assert compiled == ["distance"] * 2
    assert not list(folder.glob("distance-*"))


def test_without_a_folder_programs_run(monkeypatch: pytest.MonkeyPatch, compiled: list[str]) -> None:
    monkeypatch.setenv(cache.VARIABLE, "off")
    for _ in range(2):
        np.testing.assert_array_equal(distance_program()(MAP, reach=2), squared_distance(jnp.asarray(MAP), 2))
    assert compiled == ["distance"] * 2


def test_compiling_for_several_devices_at_a_time_traces_once() -> None:
    """Two of the threads of `concurrently`: the second one waits for the trace of the first."""
    traced: list[int] = []
    met = threading.Barrier(2)

    def slowly(x: Any) -> Any:
        traced.append(len(traced))
        time.sleep(0.2)
        return 2 * x

    program = Stored("slowly", slowly)

    def obtained(value: float) -> float:
        met.wait()
        leaves, tree = jax.tree.flatten((np.float32(value),))
        return float(program._obtained(leaves, tree, {})(*leaves))

    assert list(concurrently(obtained, [1.0, 2.0], 2)) == [2.0, 4.0]
    assert traced == [0]


def test_words_differ_where_programs_do() -> None:
    values = [
        None, True, 1, 1.0, "1", (1,), [1], {"a": 1}, {"b": 1}, np.float32(1), np.zeros(2), np.zeros(3), np.ones(2),
        jnp.ones(2, jnp.int32), Grid(), Grid((3, 3, 3)), Distances(), Distances(1.0, 5.0, Distances().price),
        conductivity, squared_distance, functools.partial(squared_distance, reach=2),
        functools.partial(squared_distance, reach=3), Grid,
    ]  # fmt: skip
    words = [executable._words(value) for value in values]
    assert len(set(words)) == len(values)
    assert words == [executable._words(value) for value in values]
    for value in (twice, lambda x: x, object()):
        with pytest.raises(executable._UnnamedError):
            executable._words(value)
