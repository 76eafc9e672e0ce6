"""A library is built once, kept, and needed by nothing: whatever goes wrong is told in one sentence."""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

import maxjax
from maxjax.compile import native
from maxjax.compile.native import NotCompiledError
from maxjax.planning.search import astar_compiled
from maxjax.verification import compiled


@pytest.fixture
def source(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """A source beside a folder for libraries, which is empty."""
    (tmp_path / "cache").mkdir()
    monkeypatch.setattr(native, "cache_folder", lambda: tmp_path / "cache")
    path = tmp_path / "answer.cpp"
    path.write_text('extern "C" int answer() { return 42; }\n')
    yield path
    native._outcome.cache_clear()


needs_compiler = pytest.mark.skipif(not any(map(shutil.which, native.COMPILERS)), reason="no C++ compiler")


def kept(source: Path) -> list[Path]:
    return sorted((source.parent / "cache").iterdir())


def script(folder: Path, text: str) -> None:
    """A program called c++ in the folder."""
    folder.mkdir()
    (folder / "c++").write_text(f"#!/bin/sh\n{text}\n")
    (folder / "c++").chmod(stat.S_IRWXU)


@pytest.mark.parametrize("what", ["no compiler", "broken compiler", "no library", "no folder"])
def test_what_cannot_be_built_is_told_in_one_sentence(what: str, source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    programs, message = source.parent / "bin", r"answer\.cpp: cannot be built or loaded"
    if what == "no compiler":
        programs.mkdir()
        message = r"expected a C\+\+ compiler \(c\+\+, g\+\+, clang\+\+\) on the PATH, found none; install one"
    elif what == "broken compiler":
        script(programs, "echo no such header >&2; exit 1")
        message = r"answer\.cpp: c\+\+ could not compile it: no such header"
    elif what == "no library":
        script(programs, 'while [ "$1" != -o ]; do shift; done; echo text > "$2"')
    else:
        script(programs, "exit 0")
        monkeypatch.setattr(native, "cache_folder", lambda: None)
        message = "there is no folder to keep its library in; set MAXJAX_CACHE"
    monkeypatch.setenv("PATH", str(programs))
    with pytest.raises(NotCompiledError, match=message):
        native.library(source)
    assert not native.available(source)
    for _ in range(2):
        assert native.at_hand(source) is None
        native._AHEAD[source].join()


@needs_compiler
def test_a_library_is_built_once_and_leaves_nothing_else(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert native.library(source).answer() == 42
    (first,) = kept(source)
    written = first.stat().st_mtime_ns
    native._outcome.cache_clear()
    assert native.library(source).answer() == 42
    assert kept(source) == [first]
    assert first.stat().st_mtime_ns == written
    monkeypatch.setattr(native, "FLAGS", (*native.FLAGS, "-DOTHER"))
    native._outcome.cache_clear()
    native.library(source)
    assert len(kept(source)) == 2


@needs_compiler
def test_a_library_at_hand_is_not_waited_for_unless_it_is_there(source: Path) -> None:
    """What was built by an earlier process is had at once; what was not is had as soon as it is built."""
    first = native.at_hand(source)
    native._AHEAD[source].join()
    for _ in range(2):
        library = native.at_hand(source)
        assert library is not None
        assert library.answer() == 42
    assert first is None or first.answer() == 42
    native._outcome.cache_clear()
    del native._AHEAD[source]
    assert native.at_hand(source) is not None
    assert len(kept(source)) == 1


def test_the_sources_are_part_of_the_package() -> None:
    package = Path(maxjax.__file__).parent
    for source in (astar_compiled.SOURCE, compiled.SOURCE):
        assert source.is_file()
        assert os.path.commonpath([source, package]) == str(package)
