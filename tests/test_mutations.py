"""The list of mutations fits the sources: each is a line that stands there once, and what it is broken to compiles."""

from __future__ import annotations

import ast

import pytest

from tests.mutate import ROOT, SURVIVORS, TESTS, Mutation, mutations


def test_each_mutation_breaks_one_line_into_another_that_compiles() -> None:
    listed = mutations()
    assert len(listed) >= 150
    assert len({(one.file, one.line, one.broken) for one in listed}) == len(listed)
    for one in listed:
        lines = (ROOT / one.file).read_text(encoding="utf-8").splitlines()
        (place,) = (k for k, line in enumerate(lines) if line.strip() == one.line)
        lines[place] = lines[place].replace(one.line, one.broken)
        assert one.broken != one.line
        ast.parse("\n".join(lines))


def test_every_room_has_tests_and_every_survivor_is_listed() -> None:
    listed = mutations()
    assert {one.room for one in listed} == set(TESTS)
    for tests in TESTS.values():
        assert all((ROOT / "tests" / name).exists() for name in tests)
    assert set(SURVIVORS) <= {(one.file, one.broken) for one in listed}


def test_a_line_that_is_gone_is_told() -> None:
    with pytest.raises(ValueError, match="expected 'no such line' once, found it 0 times; list it anew"):
        Mutation("page", "tests/test_mutations.py", "no such line", "").apply(ROOT)
