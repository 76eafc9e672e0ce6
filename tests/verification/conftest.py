"""The verifier, plain and compiled: what is true of one must be true of the other."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module", params=["plain", "compiled"])
def each_verifier(request: pytest.FixtureRequest) -> Iterator[None]:
    """Both of them, one after the other; the compiled one where there is a compiler."""
    from maxjax.verification import compiled

    library: ctypes.CDLL | None = None
    if request.param == "compiled":
        library = request.getfixturevalue("compiled_verifier")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "at_hand", lambda: library)
        yield
