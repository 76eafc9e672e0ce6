"""Pages from the command line: served until Ctrl-C, or written as one file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from maxjax.core.files import atomic_write


def wait(server: Any) -> None:
    """Say where the page is, and serve it until Ctrl-C."""
    from maxjax.ui.page.server import address_of

    print(f"{address_of(server)}   Ctrl-C ends it", flush=True)
    try:
        while True:
            time.sleep(3600.0)
    finally:
        server.stop()


def write_page(path: Path, page: str) -> None:
    """Write what is shared, whole or not at all, and say how large it is."""
    atomic_write(path, page)
    print(f"{path}   {len(page.encode()) / 1e6:.1f} MB")
