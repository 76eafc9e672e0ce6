"""The AirSim example flies by the real client, against a server of ours: it arrives, clear of the true city."""

from __future__ import annotations

import importlib.util
import json
import socket
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest

pytest.importorskip("cosysairsim", reason="needs cosysairsim (extra dev)")

from maxjax.sim.worlds.scenes import Scene, make_scene, scene_xml
from tests.airsim_server import AirSim

EXAMPLE = Path(__file__).parents[1] / "docs" / "samples" / "airsim_flight.py"
# On either side of a tower of downtown:0, which is 12 m deep there.
START, GOAL = np.array([-10.0, 58.0, 0.3]), np.array([-10.0, 33.0, 6.3])
BALL = 1e-3


@pytest.fixture(scope="module")
def example() -> ModuleType:
    """The program, with a smaller map."""
    spec = importlib.util.spec_from_file_location("airsim_flight", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.SHAPE = (49, 49, 25)
    return module


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene("downtown", 0)


def least_distance(scene: Scene, track: list[np.ndarray]) -> float:
    """From a track to the true city [m], the ground left out, by C MuJoCo."""
    ball = f'<body mocap="true"><geom type="sphere" size="{BALL}"/></body>'
    model = mujoco.MjModel.from_xml_string(scene_xml(scene.geoms).replace("</worldbody>", ball + "</worldbody>"))
    data, last = mujoco.MjData(model), model.ngeom - 1
    solids = [k for k in range(last) if model.geom_type[k] != mujoco.mjtGeom.mjGEOM_PLANE]
    least = np.inf
    for point in track:
        data.mocap_pos[0] = point
        mujoco.mj_kinematics(model, data)
        least = min(least, *(mujoco.mj_geomDistance(model, data, k, last, 20.0, None) for k in solids))
    return least + BALL


def test_it_arrives_and_keeps_the_radius_from_the_true_city(
    example: ModuleType, scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    with AirSim(scene.model, START) as server:
        given = ["--goal", *map(str, GOAL - START), "--port", str(server.port)]
        assert example.main(given) == 0
    assert capsys.readouterr().out.endswith("arrived: it hovers\n")
    assert np.linalg.norm(server.track[-1] - GOAL) < example.ARRIVED
    assert np.linalg.norm(server.velocity) < 0.05
    assert set(server.names) >= {"takeoff", "getLidarData", "getMultirotorState", "moveOnPath", "hover"}
    kept = least_distance(scene, server.track[::5])
    # The straight line leads through the tower.
    assert kept >= example.DISTANCES.radius
    assert least_distance(scene, list(np.linspace(START + np.array([0.0, 0.0, 6.0]), GOAL, 50))) < 0.0


def test_a_server_that_is_lost_in_flight_is_a_sentence(
    example: ModuleType, scene: Scene, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(example, "ANSWER", 1.0)
    with AirSim(scene.model, START, scans=3) as server:
        given = ["--goal", *map(str, GOAL - START), "--port", str(server.port)]
        assert example.main(given) == 1
    told = f"AirSim at 127.0.0.1:{server.port}: expected an answer within 1 s, given: Request timed out; start it"
    assert capsys.readouterr().err.startswith(told)


def test_the_settings_name_the_sensor_that_the_program_asks_for() -> None:
    settings = json.loads((EXAMPLE.parent / "airsim_settings.json").read_text(encoding="utf-8"))
    (vehicle,) = settings["Vehicles"].values()
    (name,) = vehicle["Sensors"]
    assert f'"--lidar", default="{name}"' in EXAMPLE.read_text(encoding="utf-8")


def test_nobody_at_the_port_is_a_sentence(example: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert example.main(["--goal", "20", "0", "5", "--port", str(port)]) == 1
    assert "given: Retry connection over the limit" in capsys.readouterr().err
