"""`maxjax view` of what was planned: the page plans by the rules of the file, or refuses with a sentence."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.ui.cli import test_cli_mission
from tests.ui.cli.test_cli_places import GOAL, SAMPLE, START, areas, degrees

pytest.importorskip("viser", reason="the page needs the extra view: pip install 'maxjax[view]'")

from maxjax.ui.cli import main
from maxjax.ui.cli.options import ViewOptions
from maxjax.ui.cli.view_command import open_request, request_shown
from maxjax.ui.figures import drawable
from maxjax.ui.page.answer import Answer, answer, describe_answer
from maxjax.ui.page.download import file_of

town = test_cli_mission.town
SQUARE = [(-15.0, -30.0), (20.0, -30.0), (20.0, 30.0), (-15.0, 30.0)]


def content_of(capsys: pytest.CaptureFixture[str], *words: object) -> Any:
    assert main([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def written(folder: Path, content: Any) -> str:
    file = folder / "plan.json"
    file.write_text(json.dumps(content))
    return str(file)


def seen(file: str, **given: Any) -> Answer:
    """What the page of a file is answered first."""
    city, request, _ = open_request(request_shown(ViewOptions(file, **given)))
    return answer(city, request)


def test_a_plan_opens_with_its_airspace_and_is_planned_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On Earth, above ground, around an area, below a ceiling above the start: the same path."""
    file = areas(tmp_path, SQUARE, lower=0, upper=120)
    ends = [repr(float(x)) for end in (START, GOAL) for x in (*degrees(*end[:2]), end[2])]
    rules = ("--floor", 3, "--ceiling-above-start", 40, "--airspace", file, "--margin", 6, "--radius", 1.5)
    words = ("plan", SAMPLE, "--frame", "agl", "--start", *ends[:3], "--goal", *ends[3:], *rules, "--method", "astar")
    planned = content_of(capsys, *words)
    around_it = seen(written(tmp_path, planned))
    assert around_it.ok
    np.testing.assert_allclose(around_it.mission.path, planned["path"], atol=1e-6)
    assert not _enters(around_it)
    del planned["configuration"]["airspace"]
    through = seen(written(tmp_path, planned))
    assert through.ok
    assert _enters(through)


def _enters(found: Answer) -> bool:
    (x0, y0), (x1, y1) = SQUARE[0], SQUARE[2]
    x, y, _ = found.dense.T
    return bool(((x > x0) & (x < x1) & (y > y0) & (y < y1)).any())


def test_a_mission_keeps_what_its_waypoints_say(
    town: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = test_cli_mission.around(town)
    planned = content_of(capsys, "mission", file)
    for source in (file, written(tmp_path, planned)):
        city, request, earth = open_request(request_shown(ViewOptions(source)))
        assert [(stop.hover, stop.speed) for stop in request.flown[1:]] == [(2.5, 3.0), (None, 6.0), (None, 6.0)]
        found = answer(city, request)
        np.testing.assert_allclose(found.mission.path, planned["path"], atol=1e-6)
        assert "hovers 2.5 s" in describe_answer(found)
        rows = file_of(city, earth, ".csv", found)[1].decode().splitlines()
        assert float(rows[-1].split(",")[0]) == pytest.approx(planned["duration"], abs=0.1)


def test_options_given_to_the_page_count_and_ends_of_a_file_are_its_own(tmp_path: Path) -> None:
    configuration = {"map": "suburb:0", "start": [-20, 0, 30], "goal": [20, 0, 30], "method": "astar", "radius": 2.0}
    file = written(tmp_path, {"configuration": configuration})
    options = request_shown(ViewOptions(file, margin=5.0))
    assert (options.map, options.method, options.radius, options.margin) == ("suburb:0", "astar", 2.0, 5.0)
    with pytest.raises(ValueError, match=r"--start: .*plan\.json has its own waypoints"):
        request_shown(ViewOptions(file, start=(0.0, 0.0, 30.0), goal=(9.0, 0.0, 30.0)))


@pytest.mark.parametrize(
    ("configuration", "words"),
    [
        ({"map": "suburb:0", "sensor": [0, 0, 5]}, "'sensor' as well; open its map"),
        ({"start": [0, 0, 5]}, "one without configuration.map"),
        ({"map": "suburb:0", "radius": "wide"}, "radius: expected a finite number, given 'wide'"),
        ({"map": "suburb:0", "start": [0, 0]}, "start: expected 3 finite numbers"),
        ({"map": "suburb:0", "waypoints": 3}, "waypoint: expected at least two tables"),
        ({"map": "suburb:0", "start": [0, 0, 30], "goal": [9, 0, 30], "airspace": "gone.geojson"}, "lies"),
    ],
)
def test_what_the_page_cannot_follow_is_refused(
    configuration: dict[str, Any], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, {"configuration": configuration})
    assert main(["view", file, "--share", str(tmp_path / "page.html")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "page.html").exists()


def test_an_end_that_a_rule_closes_is_told_which(tmp_path: Path) -> None:
    file = areas(tmp_path, SQUARE, lower=0, upper=120)
    found = seen(str(SAMPLE), start=START, goal=(0.0, 0.0, 40.0), airspace=file, method="astar")
    assert "GOAL_IN_CLOSED_AREA" in describe_answer(found)
    assert "It lies in the keep-out area 'school'." in describe_answer(found)
    below = seen(str(SAMPLE), start=START, goal=GOAL, ceiling=6.0, method="astar")
    assert "above 6 m above ground" in describe_answer(below)


def test_a_map_too_large_to_show_is_shown_in_larger_voxels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    occupied = np.zeros((40, 30, 20), bool)
    occupied[10:14, 10:14, :9] = True
    np.savez(tmp_path / "a.npz", occupied=occupied, spacing=1.0, origin=np.zeros(3))
    monkeypatch.setattr(drawable, "MOST_DRAWN", 4000)
    city, _, _ = open_request(request_shown(ViewOptions(str(tmp_path / "a.npz"))))
    assert city.grid.spacing == 2.0
    assert city.occupied.sum() == 2 * 2 * 5
    assert "drawn in voxels of 2 m" in capsys.readouterr().err
