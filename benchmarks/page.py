"""How long a page takes from a drag to a verified path, in a browser, and how many frames a second it draws.

    python -m benchmarks.page     # two CPU cores: 5 minutes; Chromium draws in software

A drag is timed in the browser: from the last movement of the mouse to the arrival of the path that answers it. Server
and browser share the machine. All windows are compiled before. Frames are counted while the camera is turned with the
mouse. What limits them is told by rows beside: a canvas that is only cleared, the page without a map, and the same
triangles drawn by WebGL alone, with the name of who computes its pixels. `load` is that of the whole machine.
"""

from __future__ import annotations

import dataclasses
import os
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import bare_webgl
from benchmarks.common.browser import HEIGHT, WIDTH, Window, browser
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, save
from maxjax.core.grid import Point3
from maxjax.core.voxel_map import VoxelMap
from maxjax.ui.cli.map_task import city_task, load_scene
from maxjax.ui.page.answer import Answer, answer
from maxjax.ui.page.camera import over_map
from maxjax.ui.page.controls import text_place
from maxjax.ui.page.draw import city_scene, city_surface
from maxjax.ui.page.page_map import City, first_ends
from maxjax.ui.page.plan_page import PlanPage
from maxjax.ui.page.server import serve
from maxjax.ui.page.stage import Stage
from maxjax.ui.request import Request

# Notes when the mouse moved last and when another path arrived.
_CLOCK = """() => {
    window.moved = 0; window.arrived = 0; let before = null;
    window.addEventListener('pointermove', event => { window.moved = event.timeStamp; }, true);
    setInterval(() => {
        const path = window.__viserSceneTree.getState()['/plan/path']?.message;
        if (path !== before) { before = path; window.arrived = performance.now(); }
    }, 2);
}"""
# Whether the path begins at a place, which it does when the answer to the last movement is there.
_ARRIVED = """place => {
    const points = window.__viserSceneTree.getState()['/plan/path']?.message.props.points;
    return points !== undefined && place.every((x, k) => Math.abs(x - points[k]) < 1e-3);
}"""
_COUNT = """() => {
    window.frames = 0; window.since = performance.now();
    const frame = () => { window.frames++; requestAnimationFrame(frame); };
    requestAnimationFrame(frame);
}"""
_RATE = "() => 1e3 * window.frames / (performance.now() - window.since)"
_CLEARED = f"""<canvas id="c" width="{WIDTH}" height="{HEIGHT}"></canvas><script>
    const gl = c.getContext('webgl2', {{antialias: true}});
    const draw = () => {{ gl.clearColor(Math.random(), 0, 0, 1); gl.clear(16384); requestAnimationFrame(draw); }};
    draw();
</script>"""

_FOV = float(np.radians(75.0))  # of viser's camera


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        map: simulated city.
        drags: number of drags.
        boxes: of the scene whose frames are counted; 0: none.
        seconds: for which frames are counted.
        sharpness: pixels drawn for one of the window, along each side.
        out: where the JSON goes.
    """

    map: str = "downtown:0"
    drags: int = 50
    boxes: int = 10_000
    seconds: float = 5.0
    sharpness: tuple[float, ...] = (1.0, 0.5)
    out: Path = RESULTS


TINY = Config(drags=2, boxes=4, seconds=0.5, sharpness=(0.5,))


def main(config: Config) -> list[Row]:
    """Time drags and count frames; save and return the rows."""
    middle = (0.0, 0.0, 40.0)
    task = city_task(load_scene(config.map), middle, middle)
    city = City(config.map, task.map)
    ends = first_ends(city)
    moves = list(_moves(city, ends, config.drags))
    place = np.array(ends[0])
    for axis, metres in moves:  # compiles what will be met
        place[axis] += metres
        answer(city, Request.between(city.name, (place[0], place[1], place[2]), ends[1]))
    rows: list[Row] = []
    with browser() as chrome:
        for sharp in config.sharpness:
            rows += _drags(chrome, city, ends, moves, sharp)
            shown = {config.map: city} | ({f"{config.boxes} boxes": _boxes(config.boxes)} if config.boxes else {})
            rows.append(_frames(chrome, city, "without a map", config.seconds, sharp, empty=True))
            for name, some in shown.items():
                rows.append(_frames(chrome, some, name, config.seconds, sharp))
                rows.append(_bare(chrome, some, name, config.seconds, sharp))
        rows.append(_cleared(chrome, config.seconds))
    save("page", config, rows, config.out)
    return rows


def _moves(city: City, ends: tuple[Point3, Point3], count: int) -> Iterator[tuple[int, float]]:
    """Random moves of the start along an axis [m] that leave it free."""
    random, place = np.random.default_rng(0), np.array(ends[0])
    while count:
        axis, metres = int(random.integers(3)), float(random.uniform(4.0, 12.0) * random.choice([-1.0, 1.0]))
        moved = place.copy()
        moved[axis] += metres
        index = np.round((moved - city.grid.origin) / city.grid.spacing).astype(int)
        around = tuple(slice(max(i - 2, 0), i + 3) for i in index)
        if np.linalg.norm(moved - ends[0]) < 30.0 and moved[2] > city.floor + 5.0 and not city.occupied[around].any():
            place, count = moved, count - 1
            yield axis, metres


def _drags(
    chrome: Any, city: City, ends: tuple[Point3, Point3], moves: list[tuple[int, float]], sharp: float
) -> list[Row]:
    server = serve(city, port=0)
    page = PlanPage(server, city, Request.between(city.name, *ends))
    window = Window(chrome)
    window.page.goto(_address(server, sharp))
    window.shown("/plan/path", 300.0)
    time.sleep(3.0)  # the first pictures
    window.page.evaluate(_CLOCK)
    waits, plans = [], []
    for axis, metres in moves:
        before = page.waypoints[0]
        window.drag("/ends/start", axis, metres, steps=2)
        found = _settled(page, before)
        if found is not None:
            window.wait(_ARRIVED, (found.dense[0] - city.frame.anchor).tolist(), seconds=20.0)
            waits.append(window.page.evaluate("() => window.arrived - window.moved") / 1e3)
            plans.append(found.seconds)
    window.close()
    page.worker.close()
    server.stop()
    label = _label(sharp)
    return [_row(f"drag to verified path{label}", waits), _row(f"of this: question to answer{label}", plans)]


def _settled(page: PlanPage, before: Point3) -> Answer | None:
    """The answer to a drag that has ended, which is when the panel says where; None where there is no path."""
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        now = page.waypoints[0]
        if now != before and text_place(page.controls.start.value) == now and page.worker.rest(10.0):
            found = page.answer
            return found if found is not None and found.ok and found.request.places[0] == now else None
        time.sleep(0.02)
    return None


def _row(what: str, seconds: list[float]) -> Row:
    return {
        "what": what,
        "unit": "s",
        "median": round(statistics.median(seconds), 4),
        "min": round(min(seconds), 4),
        "max": round(max(seconds), 4),
        "n": len(seconds),
        "load": round(os.getloadavg()[0], 1),
    }


def _frames(chrome: Any, city: City, what: str, seconds: float, sharp: float, *, empty: bool = False) -> Row:
    """Frames a second of a map, or of the page without it, while the camera turns about it."""
    server = serve(city, port=0)
    if not empty:
        Stage(server.scene).show("/map", city_scene(city))
    window = Window(chrome)
    window.page.goto(_address(server, sharp))
    window.shown("/light/sun" if empty else "/map/obstacles")
    time.sleep(3.0)
    rate = _turning(window, seconds)
    window.close()
    server.stop()
    return {
        "what": f"frames, {what}{_label(sharp)}",
        "unit": "1/s",
        "median": round(rate, 2),
        "triangles": 0 if empty else len(city_surface(city).faces),
        "load": round(os.getloadavg()[0], 1),
    }


def _bare(chrome: Any, city: City, what: str, seconds: float, sharp: float) -> Row:
    """Pictures a second of the same triangles by WebGL alone."""
    mesh, (eye, target) = city_surface(city), over_map(city)
    size = round(sharp * WIDTH), round(sharp * HEIGHT)
    window = Window(chrome)
    window.page.set_content(bare_webgl.turning(mesh, eye, target, size, _FOV))
    time.sleep(1.0)
    window.page.evaluate("() => { window.first = window.drawn; window.since = performance.now(); }")
    time.sleep(seconds)
    rate: float = window.page.evaluate("() => 1e3 * (window.drawn - window.first) / (performance.now() - window.since)")
    renderer: str = window.page.evaluate("() => window.renderer")
    window.close()
    name = f"bare WebGL, {what}{_label(sharp)}"
    return {
        "what": name,
        "unit": "1/s",
        "median": round(rate, 2),
        "triangles": len(mesh.faces),
        "load": round(os.getloadavg()[0], 1),
        "by": renderer,
    }


def _address(server: Any, sharp: float) -> str:
    return f"http://127.0.0.1:{server.get_port()}/?fixedDpr={sharp:g}"


def _label(sharp: float) -> str:
    return "" if sharp == 1.0 else ", half the resolution" if sharp == 0.5 else f", resolution {sharp:g}"


def _turning(window: Window, seconds: float) -> float:
    window.page.evaluate(_COUNT)
    window.page.mouse.move(400, 500)
    window.page.mouse.down()
    end, k = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        k += 1
        window.page.mouse.move(400 + k % 200, 500)
    rate: float = window.page.evaluate(_RATE)
    window.page.mouse.up()
    return rate


def _cleared(chrome: Any, seconds: float) -> Row:
    window = Window(chrome)
    window.page.set_content(_CLEARED)
    window.page.evaluate(_COUNT)
    time.sleep(seconds)
    rate: float = window.page.evaluate(_RATE)
    window.close()
    return {"what": "frames, a canvas that is only cleared", "unit": "1/s", "median": round(rate, 2), "triangles": 0}


def _boxes(count: int) -> City:
    """A city of that many boxes, no two of which can be joined."""
    side = int(np.ceil(np.sqrt(count)))
    tall = np.random.default_rng(0).integers(2, 30, (side, side))
    volume = np.zeros((2 * side, 2 * side, 32), bool)
    for i, j in np.ndindex(side, side):
        if i * side + j < count:
            volume[2 * i, 2 * j, 1 : 1 + tall[i, j]] = True
    ground = np.zeros_like(volume)
    ground[:, :, 0] = True
    where = VoxelMap.of(volume | ground, spacing=2.0, origin=(0.0, 0.0, 0.0), ground=ground)
    return City(f"{count} boxes", where)


if __name__ == "__main__":
    main(configured(TINY))
