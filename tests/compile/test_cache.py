"""The folder of executables: where it is, that it can be missing, and its limit."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

from maxjax.compile import cache


@pytest.fixture(autouse=True)
def _fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    cache._usable.cache_clear()
    monkeypatch.delenv(cache.VARIABLE, raising=False)


def test_it_lies_in_the_users_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    found = cache.cache_folder()
    assert found is not None
    assert found.parent == tmp_path / "xdg" / "maxjax"
    assert found.is_dir()
    if os.name == "posix":
        assert found.stat().st_mode & 0o077 == 0  # who writes there can run code as the user

    cache._usable.cache_clear()
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    of_user = ("Library", "Caches") if sys.platform == "darwin" else (".cache",)
    found = cache.cache_folder()
    assert found is not None
    assert found.parent == (tmp_path / "home").joinpath(*of_user, "maxjax")


def test_the_variable_moves_it_and_turns_it_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "mine"))
    found = cache.cache_folder()
    assert found is not None
    assert found.parent == tmp_path / "mine"
    monkeypatch.setenv(cache.VARIABLE, "off")
    assert cache.cache_folder() is None


@pytest.mark.parametrize("missing", ["a file", "nowhere"])
def test_without_a_folder_nothing_is_kept(missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a file").touch()
    home = tmp_path / missing / "home" if missing == "a file" else Path("/proc/nowhere")
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache.cache_folder() is None
    before = jax.config.values["jax_compilation_cache_dir"]
    cache.let_jax_keep()
    assert jax.config.values["jax_compilation_cache_dir"] == before


def test_above_the_limit_the_files_go_that_were_not_used_for_longest(tmp_path: Path) -> None:
    (tmp_path / "jax").mkdir()
    for k, name in enumerate(("a", "jax/b", "c", "jax/d")):
        (tmp_path / name).write_bytes(bytes(100))
        os.utime(tmp_path / name, (1e9 + k, 1e9 + k))
    os.utime(tmp_path / "a", (2e9, 1e9))  # read since
    cache.trim(tmp_path, limit=400)
    assert len([p for p in tmp_path.rglob("*") if p.is_file()]) == 4
    cache.trim(tmp_path, limit=250)
    assert sorted(p.name for p in tmp_path.rglob("*") if p.is_file()) == ["a", "d"]


_JAX = """
import jax
from maxjax.compile.cache import let_jax_keep
let_jax_keep()
print(jax.config.values["jax_compilation_cache_dir"])
"""


@pytest.mark.parametrize("own", [False, True])
def test_jax_is_given_a_folder_unless_the_user_has_given_it_one(own: bool, tmp_path: Path) -> None:
    here = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    here |= {"MAXJAX_CACHE": str(tmp_path / "maxjax")}
    here |= {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "own")} if own else {}
    done = subprocess.run([sys.executable, "-c", _JAX], env=here, capture_output=True, text=True, check=True)
    assert Path(done.stdout.strip()).is_relative_to(tmp_path / ("own" if own else "maxjax"))
