"""Run-time checks of every jaxtyping annotation in maxjax, and where the real inputs lie."""

from __future__ import annotations

import os
from pathlib import Path

# Compiling is most of what the tests cost, and none of what they state depends on LLVM's optimisations.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")

import pytest
from jaxtyping import install_import_hook

# Shapes and dtypes of all public signatures are checked in tests, and only there.
install_import_hook("maxjax", "beartype.beartype")

DATA = Path(os.environ.get("MAXJAX_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")).resolve()


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of public inputs (MAXJAX_DATA); tests that need it are skipped, with the reason, where it is absent."""
    if not DATA.is_dir():
        pytest.skip(f"no real inputs at {DATA}; set MAXJAX_DATA")
    return DATA
