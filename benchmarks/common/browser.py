"""Headless Chromium on a page of `maxjax.ui.page`: started, read, driven with the mouse; WebGL in software."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FLAGS = [
    *("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    # None of the browser's own connections.
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    "--disable-sync",
]
WIDTH, HEIGHT = 1280, 800
# What viser's page says about the machine, not about itself.
HARMLESS = ("THREE.Clock", "GPU stall", "GL Driver Message")

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


def chromium() -> str | None:
    """The browser's program; None where there is none."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next(filter(None, map(shutil.which, names)), None)


@contextlib.contextmanager
def browser() -> Iterator[Any]:
    """A browser that ends with the block.

    Raises:
        ImportError: without playwright.
        OSError: without Chromium.
    """
    from playwright.sync_api import sync_playwright

    path = chromium()
    if path is None:
        raise OSError("expected Chromium on this machine, given none: apt-get install chromium")
    with sync_playwright() as playwright:
        instance = playwright.chromium.launch(executable_path=path, headless=True, args=FLAGS)
        try:
            yield instance
        finally:
            instance.close()


class Window:
    """A page in a browser.

    Attributes:
        page: playwright's.
        errors: that its console held.
        requests: addresses that it asked for.

    Args:
        browser: of `browser`.
        offline: whether it has no network.
        size: width and height [px].
    """

    def __init__(self, browser: Any, *, offline: bool = False, size: tuple[int, int] = (WIDTH, HEIGHT)) -> None:
        self.context = browser.new_context(viewport={"width": size[0], "height": size[1]}, offline=offline)
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
        """Type of what is shown under a name of the scene; None where there is nothing."""
        return self.page.evaluate("n => window.__viserSceneTree?.getState()[n]?.message.type ?? null", name)

    def points(self, name: str) -> list[float]:
        """Coordinates of the line under a name, flat; empty where there is none."""
        found: list[float] = self.page.evaluate(
            "n => Array.from(window.__viserSceneTree?.getState()[n]?.message.props.points ?? [])", name
        )
        return found

    def wait(self, condition: str, argument: Any = None, seconds: float = 60.0) -> None:
        """Wait until JavaScript is true."""
        self.page.wait_for_function(condition, arg=argument, timeout=1e3 * seconds, polling=50)

    def shown(self, name: str, seconds: float = 60.0) -> None:
        """Wait until something is shown under a name."""
        self.wait("n => window.__viserSceneTree?.getState()[n] !== undefined", name, seconds)

    def on_screen(self, name: str, point: tuple[float, float, float]) -> tuple[float, float]:
        """Where a point [m] of a node's frame is seen [px]."""
        x, y = self.page.evaluate(_PROJECT, [name, list(point)])
        return x, y

    def drag(self, name: str, axis: int, metres: float, grip: float = 9.0, steps: int = 3) -> None:
        """Drag a handle by its arrow along an axis, with the mouse."""
        places = []
        for along in (grip, grip + metres):
            point = [0.0, 0.0, 0.0]
            point[axis] = along
            places.append(self.on_screen(name, (point[0], point[1], point[2])))
        mouse = self.page.mouse
        mouse.move(*places[0])
        mouse.down()
        mouse.move(*places[1], steps=steps)
        mouse.up()

    def picture(self, file: Path) -> Path:
        """A screenshot."""
        self.page.screenshot(path=str(file), timeout=90_000)
        return file

    def close(self) -> None:
        """End it."""
        self.context.close()
