"""A day of service in one process: whether memory, files and threads stay what they are after the first hours.

    python -m benchmarks.service     # two CPU cores: 12 minutes

    24 h / 50,000 plans = a plan every 1.7 s; here they are asked without the pauses between

Turns go round. In each the map is a new one, which is planned in by a field and by A*, with a mission, and anew from a
scan; and a browser's client comes to a page over a WebSocket, drags the start to another place, waits for the new path
and goes. Memory is what the process holds in RAM; handles are its open files and sockets, counted, as threads are, when
no client is there. What is held after the first fifth of the plans has to be held at the end, within 5 %.

At last processes write one folder of executables at once (`common.folder_writers`). Needs Linux, whose /proc is read.
"""

from __future__ import annotations

import dataclasses
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.folder_writers import written_at_once
from benchmarks.common.harness import RESULTS, Row, keep, save
from maxjax.core.grid import Point3
from maxjax.ui.page.draw import root_of
from maxjax.ui.page.page_map import City
from maxjax.ui.page.plan_page import PlanPage
from maxjax.ui.page.server import serve
from maxjax.ui.request import Request

_SHAPE, _SPACING = (32, 32, 24), 2.0
_START, _MIDDLE, _GOAL = (6.0, 6.0, 30.0), (34.0, 8.0, 34.0), (56.0, 54.0, 30.0)
_BY_FIELD, _BY_ASTAR = 6, 10  # plans of a turn
_A_TURN = _BY_FIELD + _BY_ASTAR + 2 + 1 + 1  # with a mission of two legs, one from a scan, and one of the page
_WARM = 0.2  # of the plans
_TURN = {"wxyz": (1.0, 0.0, 0.0, 0.0)}
# What a browser says first, and as the start is dragged.
_CAMERA = {"type": "ViewerCameraMessage", "position": (0.0, -90.0, 90.0), "look_at": (0.0, 0.0, 0.0), **_TURN} | {
    "up_direction": (0.0, 0.0, 1.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 900.0,
    "image_width": 800,
    "image_height": 600,
}
_DRAG = {"type": "TransformControlsUpdateMessage", "name": root_of("start"), "owner": "", **_TURN}


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        plans: in one process.
        looks: at what the process holds.
        processes: that write one folder.
        seed: of maps, ends and scans.
        out: where the JSON goes.
    """

    plans: int = 50_000
    looks: int = 50
    processes: int = 8
    seed: int = 0
    out: Path = RESULTS


TINY = Config(plans=60, looks=3, processes=2)


def main(config: Config) -> list[Row]:
    """Serve, look and write; save and return the rows."""
    rows: list[Row] = []
    with _page() as ask:
        random, solved, started = np.random.default_rng(config.seed), 0, time.perf_counter()
        scanner = maxjax.Replanner(_town(random).grid)
        scanner.warmup()
        turns = -(-config.plans // _A_TURN)
        looks = {-(-turns * k // config.looks) for k in range(1, config.looks + 1)}
        for turn in range(1, turns + 1):
            solved += _turn(random, scanner, ask)
            if turn in looks:
                seconds = round(time.perf_counter() - started, 1)
                done = {"plans": turn * _A_TURN, "solved": solved, "clients": turn, "seconds": seconds}
                rows.append({"what": "service", **done, **held()})
                keep("service", config, rows, config.out)
    rows.append(flatness(rows))
    with tempfile.TemporaryDirectory() as folder:
        town = _town(np.random.default_rng(config.seed))
        rows.append(written_at_once(Path(folder), (town, _START, _GOAL), config.processes))
    save("service", config, rows, config.out)
    return rows


def held() -> dict[str, float | int]:
    """What this process holds: memory [MB], open files and sockets, threads."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return {
        "memory_MB": round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 2),
        "handles": len(os.listdir("/proc/self/fd")) - 1,  # but for the one that lists them
        "threads": len(os.listdir("/proc/self/task")),
    }


def flatness(looks: Sequence[Row]) -> Row:
    """The first and the last fifth of what was looked at after the warm-up, beside each other: medians."""
    warm = looks[int(_WARM * len(looks)) :]
    few = max(len(warm) // 5, 1)

    def ends(key: str) -> tuple[float, float]:
        first, last = (statistics.median(float(row[key] or 0) for row in part) for part in (warm[:few], warm[-few:]))
        return first, last

    found = {f"{key}_{end}": value for key in ("memory_MB", "handles", "threads") for end, value in _named(ends(key))}
    return {"what": "after the warm-up", **found}


def _named(pair: tuple[float, float]) -> Iterator[tuple[str, float]]:
    yield from zip(("first", "last"), pair, strict=True)


def _town(random: np.random.Generator) -> maxjax.VoxelMap:
    """Blocks on a floor, in which the ends of all problems are free."""
    occupied = np.zeros(_SHAPE, bool)
    ground = occupied.copy()
    ground[:, :, 0] = True
    for i, j in random.integers(2, 26, (8, 2)):
        occupied[i : i + 4, j : j + 4, 1 : random.integers(5, 12)] = True
    return maxjax.VoxelMap.of(occupied | ground, spacing=_SPACING, origin=(0.0, 0.0, 0.0), ground=ground)


def _turn(random: np.random.Generator, scanner: maxjax.Replanner, ask: Callable[[Point3], bool]) -> int:
    """One of each; how many plans are OK."""
    town, fine = _town(random), 0
    for planner, count in ((maxjax.Field(), _BY_FIELD), (maxjax.AStar(), _BY_ASTAR)):
        for _ in range(count):
            fine += maxjax.plan(town, _near(random, _START), _GOAL, planner=planner).status == maxjax.Status.OK
    mission = maxjax.plan_mission(town, [_near(random, _START), _MIDDLE, _GOAL])
    fine += sum(leg.status == maxjax.Status.OK for leg in mission.legs)
    scan = random.uniform((10.0, 10.0, 2.0), (50.0, 50.0, 20.0), (200, 3))
    fine += scanner.replan(scan, _near(random, _START), _GOAL, deadline=60.0, known=town).status == maxjax.Status.OK
    return fine + ask(_near(random, _START))


def _near(random: np.random.Generator, place: Point3) -> Point3:
    """A place within a few metres [m]."""
    x, y, z = np.round(place + random.uniform(-4.0, 4.0, 3), 3).tolist()
    return x, y, z


@contextmanager
def _page() -> Iterator[Callable[[Point3], bool]]:
    """A page, and what a client does there that comes, drags the start to a place, and goes once a path is there."""
    import msgspec
    import viser
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    city = City("town", _town(np.random.default_rng(0)))
    server = serve(city, port=0)
    page = PlanPage(server, city, Request.between("town", _START, _GOAL))
    address = f"ws://127.0.0.1:{server.get_port()}"
    protocol = Subprotocol(f"viser-v{viser.__version__}")

    def until(done: Callable[[], Any], what: str) -> None:
        end = time.monotonic() + 60.0
        while not done():
            if time.monotonic() > end:
                raise TimeoutError(f"the page: expected {what} within a minute")
            time.sleep(0.002)

    def ask(place: Point3) -> bool:
        with connect(address, subprotocols=[protocol], proxy=None, max_size=None) as client:
            client.recv(timeout=60.0)  # the scene
            client.send(msgspec.msgpack.encode(_CAMERA))
            until(server.get_clients, "a client")
            where = city.frame.page(np.array(place)).tolist()
            client.send(msgspec.msgpack.encode(_DRAG | {"position": where}))
            until(lambda: page.answer is not None and page.answer.request.places[0] == place, "an answer")
        until(lambda: not server.get_clients(), "the client to be gone")
        return page.answer is not None and page.answer.ok

    try:
        yield ask
    finally:
        page.worker.close()
        server.stop()


if __name__ == "__main__":
    main(configured(TINY))
