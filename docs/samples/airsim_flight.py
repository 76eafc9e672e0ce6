"""Fly to a place in Cosys-AirSim by LiDAR: take a scan, plan, follow, until the vehicle is there.

    python docs/samples/airsim_flight.py --goal 60 20 10        # [m] east, north and up of where the vehicle started

AirSim speaks NED, and x forward, y right, z down on the vehicle and its sensor; all else here is ENU. It needs
airsim_settings.json beside this file; docs/airsim.md says more.
"""

from __future__ import annotations

import argparse
import sys
import time

import cosysairsim
import numpy as np
from msgpackrpc.error import RPCError
from scipy.spatial.transform import Rotation

import maxjax

SHAPE, SPACING = (121, 121, 41), 1.0  # of the map, half-way between start and goal: voxels, and their edge [m]
DISTANCES = maxjax.Distances(radius=1.5, margin=5.0)  # 0.5 m of vehicle, and 1 m by which AirSim leaves a path
BODY = 0.6  # returns nearer to the vehicle's middle are its own arms [m]
ARRIVED = 1.0  # from the goal [m]
ANSWER = 10.0  # longest wait for the simulator [s]
PATIENCE = 50  # scans in a row without a path
SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # NED to ENU, and back


def read_vector(given: cosysairsim.Vector3r) -> np.ndarray:
    """Three numbers of AirSim."""
    return np.array([given.x_val, given.y_val, given.z_val])


def read_rotation(given: cosysairsim.Quaternionr) -> Rotation:
    """A rotation of AirSim."""
    return Rotation.from_quat([given.x_val, given.y_val, given.z_val, given.w_val])


def place_scan(scan: cosysairsim.LidarData, state: cosysairsim.MultirotorState) -> np.ndarray:
    """Returns of a scan (n, 3) [m], ENU, from the sensor's frame by its pose on the vehicle."""
    points = np.asarray(scan.point_cloud, float).reshape(-1, 3)
    points = points[np.any(points != 0.0, axis=1)]  # a beam without a return is a point at the sensor
    mount, vehicle = scan.pose, state.kinematics_estimated
    since = 1e-9 * (int(state.timestamp) - int(scan.time_stamp))
    position = read_vector(vehicle.position) - since * read_vector(vehicle.linear_velocity)
    on_vehicle = read_rotation(mount.orientation).apply(points) + read_vector(mount.position)
    on_vehicle = on_vehicle[np.linalg.norm(on_vehicle, axis=1) > BODY]
    return (read_rotation(vehicle.orientation).apply(on_vehicle) + position) @ SWAP


def fly(client: cosysairsim.MultirotorClient, lidar: str, goal: np.ndarray, speed: float) -> str:
    """Take off and fly to the goal [m], ENU; what ended the flight, empty if it arrived."""
    client.ping()
    grid = maxjax.Grid.centered(tuple(0.5 * goal), SHAPE, SPACING)
    replanner = maxjax.Replanner(grid, distances=DISTANCES)
    replanner.warmup()  # on the ground: programs are compiled, or read from disk
    client.enableApiControl(True)
    client.armDisarm(True)
    client.takeoffAsync().get()
    known, last, failures = None, None, 0
    while failures < PATIENCE:
        scan = client.getLidarData(lidar)
        if scan.time_stamp == last:
            time.sleep(0.01)
            continue
        last, state = scan.time_stamp, client.getMultirotorState()
        position = read_vector(state.kinematics_estimated.position) @ SWAP
        if np.linalg.norm(goal - position) < ARRIVED:
            client.hoverAsync().get()
            return ""
        found = replanner.replan(place_scan(scan, state), position, goal, deadline=0.1, known=known)
        known = found.map  # scans are gathered
        if found.plan is None:
            failures += 1
            client.moveByVelocityAsync(0.0, 0.0, 0.0, duration=1.0)  # brake
            continue
        failures = 0
        way = [cosysairsim.Vector3r(*map(float, point)) for point in found.plan.path[1:] @ SWAP]
        client.moveOnPathAsync(way, speed)
        print(f"{np.linalg.norm(goal - position):5.1f} m to go, {found.plan.clearance:.1f} m clear", end="\r")
    client.hoverAsync().get()
    return f"no path for {PATIENCE} scans, it hovers: {found.status.advice}"


def main(given: list[str] | None = None) -> int:
    """Fly; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--goal", type=float, nargs=3, required=True, metavar=("EAST", "NORTH", "UP"))
    parser.add_argument("--speed", type=float, default=4.0, help="[m/s]")
    parser.add_argument("--lidar", default="Lidar", help="its name in settings.json")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=41451)
    told = parser.parse_args(given)
    client = cosysairsim.MultirotorClient(told.host, told.port, timeout_value=ANSWER)
    try:
        ended = fly(client, told.lidar, np.array(told.goal), told.speed)
    except RPCError as error:
        ended = (
            f"AirSim at {told.host}:{told.port}: expected an answer within {ANSWER:g} s, given: {error}; "
            "start it with docs/samples/airsim_settings.json. A vehicle in flight goes to the end of its last path"
        )
    except KeyboardInterrupt:
        client.moveByVelocityAsync(0.0, 0.0, 0.0, duration=1.0).get()
        ended = "interrupted: it hovers"
    print(ended or "arrived: it hovers", file=sys.stderr if ended else sys.stdout)
    return int(bool(ended))


if __name__ == "__main__":
    sys.exit(main())
