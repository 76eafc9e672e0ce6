"""Headless Chromium for tests: what it needs here, and what is read from a page in it."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

# Software WebGL; and none of the browser's own connections.
FLAGS = [
    *("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    "--disable-sync",
]
SIZE = {"width": 1280, "height": 800}
# What viser's page says about the machine, not about itself.
HARMLESS = ("THREE.Clock", "GPU stall", "GL Driver Message")


def chromium() -> str:
    """The browser; skips the test, with the reason, where there is none."""
    pytest.importorskip("playwright", reason="no playwright: pip install playwright")
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    return found


@contextlib.contextmanager
def browser() -> Iterator[Any]:
    """A browser that ends with the block."""
    path = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        instance = playwright.chromium.launch(executable_path=path, headless=True, args=FLAGS)
        try:
            yield instance
        finally:
            instance.close()


class Window:
    """A page in a browser: errors and requests are kept."""

    def __init__(self, browser: Any, *, offline: bool = False) -> None:
        self.context = browser.new_context(viewport=SIZE, offline=offline)
        self.page = self.context.new_page()
        self.page.set_default_timeout(60_000)
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", self._heard)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning") and not any(word in message.text for word in HARMLESS):
            self.errors.append(f"{message.type}: {message.text}")

    def node(self, name: str) -> Any:
        """What the page shows under a name of the scene, without its arrays; None where there is nothing."""
        return self.page.evaluate(
            "n => { const node = window.__viserSceneTree?.getState()[n];"
            " return node ? {type: node.message.type, visible: node.visibility ?? true} : null }",
            name,
        )

    def points(self, name: str) -> list[float]:
        """Coordinates of the line under a name, flat; empty where there is none."""
        return self.page.evaluate(
            "n => Array.from(window.__viserSceneTree?.getState()[n]?.message.props.points ?? [])", name
        )

    def wait(self, condition: str, argument: Any = None, seconds: float = 60.0) -> None:
        """Wait until JavaScript is true."""
        self.page.wait_for_function(condition, arg=argument, timeout=1e3 * seconds, polling=50)

    def shown(self, name: str, seconds: float = 60.0) -> None:
        """Wait until something is shown under a name."""
        self.wait("n => window.__viserSceneTree?.getState()[n] !== undefined", name, seconds)

    def picture(self, file: Path) -> Path:
        """A screenshot."""
        self.page.screenshot(path=str(file), timeout=90_000)
        return file

    def close(self) -> None:
        self.context.close()


# The place on the screen of a point in a node's own frame.
_PROJECT = """([name, p]) => {
    const camera = window.__viserMutable.camera, node = window.__viserMutable.nodeRefFromName[name];
    node.updateWorldMatrix(true, false);
    const times = (m, v) => [0, 1, 2, 3].map(i => m[i] * v[0] + m[4 + i] * v[1] + m[8 + i] * v[2] + m[12 + i] * v[3]);
    let v = [...p, 1];
    for (const m of [node.matrixWorld, camera.matrixWorldInverse, camera.projectionMatrix]) v = times(m.elements, v);
    const box = window.__viserMutable.canvas.getBoundingClientRect();
    return [box.x + box.width * (v[0] / v[3] + 1) / 2, box.y + box.height * (1 - v[1] / v[3]) / 2];
}"""


def on_screen(window: Window, name: str, point: tuple[float, float, float]) -> tuple[float, float]:
    """Where a point [m] of a node's frame is seen [px]."""
    x, y = window.page.evaluate(_PROJECT, [name, list(point)])
    return x, y


def drag(window: Window, name: str, axis: int, metres: float, grip: float = 9.0, steps: int = 3) -> None:
    """Drag a handle by its arrow along an axis, with the mouse."""
    unit = [float(k == axis) for k in range(3)]
    first, last = (on_screen(window, name, tuple((grip + by) * e for e in unit)) for by in (0.0, metres))
    mouse = window.page.mouse
    mouse.move(*first)
    mouse.down()
    mouse.move(*last, steps=steps)
    mouse.up()
