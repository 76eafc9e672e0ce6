"""The page in a real browser: headless Chromium, driven with the mouse; skipped where there is none.

Screenshots lie in the tests' temporary folder (`--basetemp`), or where MAXJAX_SCREENSHOTS says.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page needs the extra view: pip install 'maxjax[view]'")
pytest.importorskip("playwright", reason="no playwright: pip install playwright")

from benchmarks.common.browser import Window, browser, chromium
from maxjax.planning.waypoint import Waypoint
from maxjax.sim.loop.flight import Flight
from maxjax.sim.trials.outcomes import Outcome
from maxjax.ui.cli.viewing_flights import caption
from maxjax.ui.page import building_inspector
from maxjax.ui.page.answer import answer
from maxjax.ui.page.download import file_of
from maxjax.ui.page.flight_page import FlightPage
from maxjax.ui.page.inspection_answer import InspectionAnswer, inspect_building
from maxjax.ui.page.page_map import City
from maxjax.ui.page.plan_page import PlanPage
from maxjax.ui.page.server import serve
from maxjax.ui.page.share import MOST_BYTES, playing_page
from maxjax.ui.page.trial_folder import city_of, film_of, open_folder
from maxjax.ui.request import Request
from maxjax.ui.request_files import load_mission
from tests.ui.page.flown import folder
from tests.ui.page.test_page import town

START, GOAL = (8.0, 10.0, 10.0), (58.0, 50.0, 12.0)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    given = os.environ.get("MAXJAX_SCREENSHOTS")
    folder = Path(given) if given else tmp_path_factory.mktemp("screenshots")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture(scope="module")
def chrome() -> Iterator[Any]:
    if chromium() is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    with browser() as instance:
        yield instance


@pytest.fixture(scope="module")
def city() -> City:
    return town()


@pytest.fixture
def page(city: City) -> Iterator[PlanPage]:
    server = serve(city, port=0)
    shown = PlanPage(server, city, Request.between("town", START, GOAL))
    yield shown
    shown.close()
    server.stop()


@pytest.fixture
def window(chrome: Any, page: PlanPage) -> Iterator[Window]:
    opened = Window(chrome)
    opened.page.goto(f"http://127.0.0.1:{page._server.get_port()}/")
    opened.shown("/plan/path", 120.0)
    yield opened
    opened.close()


def until(what: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_drag_changes_the_path_and_sliders_act(window: Window, page: PlanPage, pages: Path) -> None:
    before = window.points("/plan/path")
    window.drag("/ends/start", 1, 8.0)
    until(lambda: page.worker.rest(60.0) and page.waypoints[0] != START)
    assert page.waypoints[0][1] > START[1] + 1.0
    window.wait("([n, x]) => Math.abs(window.__viserSceneTree.getState()[n].message.props.points[1] - x) < 1e-3",
                ["/plan/path", page.answer.dense[0, 1] - page._city.frame.anchor[1]])  # fmt: skip
    assert window.points("/plan/path") != before
    window.picture(pages / "drag.png")

    answered = page.answer
    box = window.page.get_by_label("A* beside it").first
    box.click()
    window.shown("/plan/astar")
    until(lambda: page.answer is not answered and page.worker.rest(60.0))
    slider = window.page.locator("input").nth(9)
    assert slider is not None
    page.controls.radius.value = 3.0  # what the slider's message does
    until(lambda: page.answer.request.radius == 3.0)
    assert page.answer.mission.radius == 3.0
    window.wait("() => document.body.innerText.includes('radius 3 m')")
    assert window.errors == []


def inside(place: tuple[float, float], width: float, height: float) -> bool:
    return 0.0 < place[0] < width and 0.0 < place[1] < height


def test_on_a_telephone_both_ends_are_seen_above_the_panel(chrome: Any, page: PlanPage, pages: Path) -> None:
    window = Window(chrome, size=(390, 844))
    window.page.goto(f"http://127.0.0.1:{page._server.get_port()}/")
    window.shown("/plan/path", 120.0)
    top = "() => document.querySelector('[style*=\"max-height: 60%\"]').getBoundingClientRect()"
    sheet = window.page.evaluate(f"() => (({top})()).toJSON()")
    assert sheet["width"] == 390
    assert sheet["height"] <= 0.37 * 844
    for name in ("/ends/start", "/ends/goal"):
        until(lambda name=name: inside(window.on_screen(name, (0.0, 0.0, 0.0)), 390.0, sheet["top"]), 20.0)
    window.picture(pages / "telephone.png")
    assert window.errors == []
    window.close()


def test_a_click_adds_a_waypoint_and_a_status_says_why_there_is_no_path(
    window: Window, page: PlanPage, pages: Path
) -> None:
    page.controls.click.value = "adds a waypoint"
    time.sleep(0.5)
    x, y = window.on_screen("/ends/start", (20.0, -4.0, -8.0))
    window.page.mouse.click(x, y)
    until(lambda: len(page.waypoints) == 3)
    assert page.waypoints[1][2] >= 12.0
    window.shown("/ends/waypoint_1/ball")
    until(lambda: page.worker.rest(60.0) and page.answer.request.places == page.waypoints)
    assert page.answer.ok
    page.change((page._stops[0], page._stops[-1]))
    page.move(0, (22.0, 30.0, 10.0))
    window.wait("() => document.body.innerText.includes('START_OCCUPIED')")
    window.wait("() => !document.body.innerText.includes('path: clearance')")
    window.wait("() => window.__viserSceneTree.getState()['/plan/path'] === undefined")
    window.picture(pages / "no_path.png")
    assert window.errors == []


def test_a_click_inspects_a_building_while_paths_are_planned(
    window: Window, page: PlanPage, pages: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long inspection holds no plan up; then it is drawn, told, and taken away by one click."""
    gate = threading.Event()

    def inspect_later(*asked: Any) -> InspectionAnswer:
        assert gate.wait(60.0)
        return inspect_building(*asked)

    monkeypatch.setattr(building_inspector, "inspect_building", inspect_later)
    controls = page.controls.inspection
    page.controls.click.value = "inspects a building"
    controls.distance.value, controls.forward.value, controls.sideways.value = 10.0, 30.0, 0.0
    time.sleep(0.5)
    roof = page._city.frame.page((22.0, 30.0, 28.0))
    window.page.mouse.click(*window.on_screen("/map", tuple(roof.tolist())))
    window.wait("() => document.body.innerText.includes('Inspecting …')")
    page.move(0, (8.0, 6.0, 10.0))
    until(lambda: page.answer.request.places[0] == (8.0, 6.0, 10.0))
    assert page.answer.ok
    assert not gate.is_set()
    gate.set()
    window.shown("/inspection/surface", 120.0)
    window.wait("() => document.body.innerText.includes('Inspection of part 1')")
    inspected = page.inspector.answer.verified
    assert inspected.coverage.share() > 0.99
    assert len(window.points("/inspection/sights")) == 6 * len(inspected.photos)
    assert window.node("/inspection/places") == "PointCloudMessage"
    until(lambda: page.worker.rest(60.0))
    window.picture(pages / "inspection.png")
    tab = window.page
    tab.get_by_text("Inspect a building", exact=True).click()
    tab.get_by_role("button", name=".tum", exact=True).first.click()
    with tab.expect_download() as download:
        tab.get_by_role("button", name="inspection.tum").click()
    places = np.loadtxt(download.value.path())[:, 1:4]
    np.testing.assert_allclose(places[[0, -1]], inspected.mission.path[[0, -1]], atol=1e-3)

    free = page._city.frame.page((60.0, 8.0, 2.0))
    window.page.mouse.click(*window.on_screen("/map", tuple(free.tolist())))
    window.wait("() => document.body.innerText.includes('Cannot be inspected')")
    window.wait("() => window.__viserSceneTree.getState()['/inspection/surface'] === undefined")
    assert window.errors == []


def test_waypoints_are_typed_and_the_mission_is_taken_away(window: Window, page: PlanPage, pages: Path) -> None:
    """Its file, read by `load_mission`, asks the same."""
    tab = window.page
    tab.get_by_text("Waypoints", exact=True).click()
    tab.get_by_role("button", name="Add", exact=True).click()
    until(lambda: len(page.waypoints) == 3)
    for label, text in (("Hover [s]", "2.5"), ("Heading [°]", "45"), ("Place", "34, 40, 20")):
        field = tab.locator(f"xpath=//label[text()='{label}']/following::input[1]")
        field.fill(text)
        field.press("Enter")
    until(lambda: page._stops[1].position == (34.0, 40.0, 20.0) and page._stops[1].heading == 45.0)
    until(lambda: page.worker.rest(60.0) and page.answer.request.places == page.waypoints)
    window.picture(pages / "waypoints.png")
    tab.get_by_text("Take away", exact=True).click()
    tab.get_by_role("button", name=".toml", exact=True).click()
    with tab.expect_download() as download:
        tab.get_by_text("mission.toml").click()
    asked = load_mission(download.value.path())
    assert asked.stops == (Waypoint(START), Waypoint((34.0, 40.0, 20.0), hover=2.5, heading=45.0), Waypoint(GOAL))
    assert window.errors == []


def test_slices_are_shown_and_the_page_is_dark(window: Window, page: PlanPage, pages: Path) -> None:
    page.controls.slice.value = "cost to the goal, −ℓ log φ"
    window.shown("/slice/plane", 120.0)
    page.controls.dark.value = True
    window.wait("() => document.querySelector('[data-mantine-color-scheme=dark]') !== null")
    page.controls.slice.value = "price of a metre"
    until(lambda: page.worker.rest(60.0))
    assert window.node("/slice/plane") == "ImageMessage"
    window.picture(pages / "slice.png")
    assert window.errors == []


def test_a_shared_page_opens_from_disk_without_network_and_plays(
    chrome: Any, city: City, pages: Path, tmp_path: Path
) -> None:
    found = answer(city, Request.between("town", START, GOAL, beside=True))
    name, content = file_of(city, None, ".html", found)
    assert len(content) < 10_000_000
    file = tmp_path / name
    file.write_bytes(content)
    window = Window(chrome, offline=True)
    window.page.goto(file.as_uri())
    window.shown("/plan/path")
    np.testing.assert_allclose(window.points("/plan/path")[:3], found.dense[0] - city.frame.anchor, atol=1e-4)
    position = "() => Array.from(window.__viserMutable.nodePoseData['/vehicle'].position)"
    first = window.page.evaluate(position)
    window.wait(f"a => Math.hypot(...({position})().map((x, k) => x - a[k])) > 3", first)
    window.picture(pages / "shared.png")
    assert "Verified path" in window.page.inner_text("#caption")
    assert window.errors == []
    assert [url for url in window.requests if not url.startswith(("file:", "blob:", "data:"))] == []
    window.close()


def test_no_file_of_the_machine_is_served(page: PlanPage) -> None:
    import http.client

    for path in ("/../../../../../../etc/passwd", "/%2e%2e/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/index.html/.."):
        connection = http.client.HTTPConnection("127.0.0.1", page._server.get_port(), timeout=10.0)
        connection.request("GET", path)
        assert connection.getresponse().status == 404
        connection.close()
    assert page._server.get_host() == "127.0.0.1"
    assert page._server.request_share_url() is None


def test_flights_play_on_a_timeline_and_a_shared_flight_opens_from_disk(
    chrome: Any, pages: Path, tmp_path: Path
) -> None:
    name, ledger = open_folder(folder(tmp_path))
    server = serve(city_of(name, 0), port=0)

    def again(_: Outcome) -> tuple[Flight, ...]:
        raise ValueError("no command line flies it again")

    page = FlightPage(server, name, ledger, again, 0)
    window = Window(chrome)
    window.page.goto(f"http://127.0.0.1:{server.get_port()}/")
    window.shown("/flown/line")
    place = "() => Array.from(window.__viserMutable.nodePoseData['/vehicle'].position)"
    first = window.page.evaluate(place)
    moved = f"a => Math.hypot(...({place})().map((x, k) => x - a[k])) > 3"
    window.wait(moved, first)
    window.page.get_by_role("button", name="Pause").click()
    until(lambda: not page.playing)
    window.picture(pages / "flight.png")
    window.page.get_by_role("button", name="Fly it again").click()
    window.wait("() => document.body.innerText.includes('no command line flies it again')")
    page.list.value = "1: IN_CONTACT, 64 m"
    window.wait("() => document.body.innerText.includes('Trial 1: IN_CONTACT')")
    page.list.value = "2: not flown"
    window.wait("() => window.__viserSceneTree.getState()['/flown/line'] === undefined")
    assert window.errors == []
    window.close()
    page.close()
    server.stop()

    outcome = ledger.outcomes[0]
    film = film_of(outcome, ledger.positions()[0], city_of(name, 0))
    file = tmp_path / "flight.html"
    file.write_text(playing_page(city_of(name, 0), film, caption(name, outcome), dark=True), encoding="utf-8")
    assert file.stat().st_size < MOST_BYTES
    window = Window(chrome, offline=True)
    window.page.goto(file.as_uri())
    window.shown("/flown/line")
    window.wait(moved, window.page.evaluate(place))
    window.picture(pages / "shared_flight.png")
    assert window.errors == []
    window.close()
