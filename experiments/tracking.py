"""Seeing movers: recall, precision, errors, and whether sets hold the truth, of scripted flights among movers.

    python -m experiments.tracking                     # one core: 5 minutes

A vehicle flies 5 m/s through streets of downtown and suburb, turning and tilting, with the default sensor. Around it 10
or 30 spheres and boxes of 0.3 to 1 m move through free air at 2, 5 or 8 m/s, half of them straight, half to and fro;
none turns about itself. In the field of SANDO's dynamic benchmark (arXiv 2604.07599: 50, 100, 200 obstacles, 65 % of
them moving on trefoils) it flies beside the obstacles. Each scan is looked at as on board; truth is computed in
float64. Spread is the width of a velocity's set, also 0.3, 0.6 and 1 s after a track was confirmed.

A mover counts where it gave five returns or more within 25 m. Tracks and movers are paired, nearest first, where place
and middle are less than 1 m apart, or the set holds the middle. A set holds a mover if its middle and velocity lie in
it, and its box in the set's; a body is held if its box is. MOTA = 1 − (missed + false + swapped) / movers that count.

Expected: no confirmed track where nothing moves. In cities recall and precision of at least 95 %, 0.2 m and 0.4 m/s in
the median; at 2 m/s recall is lower, for a body shows itself by where it was not before. In the field slow obstacles
that touch or overlap others are found late, and beams of 0.4 m that were missed before are taken for movers.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial.transform import Rotation

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, table
from experiments.moving_worlds import trefoils
from maxjax.sim.movers.perception import PerceptionState, initial_perception, process_scan
from maxjax.sim.movers.reachable_sets import Bounds, Tracks
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Lidar, scan
from maxjax.sim.worlds.geoms import BOX, SPHERE, Geoms, concatenate, ground_plane
from maxjax.sim.worlds.movers import Movers, Moving
from maxjax.sim.worlds.scenes import make_scene
from maxjax.sim.worlds.solid_distance import distance

RESULTS = Path(__file__).parent / "results"
Array3 = Float64[np.ndarray, "m 3"]

_PERIOD = 0.1  # of looks [s]
_SPEED = 5.0  # of the vehicle [m/s]
_WITHIN, _RETURNS = 25.0, 5
_PAIR = 1.0  # [m]
# Looks after the one that confirmed a track, at which velocities are looked at: 0.3, 0.6 and 1 s.
_SINCE = (3, 6, 10)
# The first looks have nothing to compare with.
_FIRST = 5


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        worlds: cities, or "field".
        counts: movers in a city.
        speeds: of these [m/s].
        obstacles: of the field.
        first: seed of the first flight of each row; those below 20 served to choose margins.
        seeds: flights of each row.
        looks: of a flight.
        channels, rays: of the sensor.
        name: of the result file.
        out: where the JSON goes.
    """

    worlds: tuple[str, ...] = ("downtown", "suburb", "field")
    counts: tuple[int, ...] = (0, 10, 30)
    speeds: tuple[float, ...] = (2.0, 5.0, 8.0)
    obstacles: tuple[int, ...] = (50, 100, 200)
    first: int = 20
    seeds: int = 2
    looks: int = 60
    channels: int = 64
    rays: int = 32768
    name: str = "tracking"
    out: Path = RESULTS


TINY = Config(worlds=("suburb",), counts=(2,), speeds=(5.0,), seeds=1, looks=7, channels=16, rays=1024)


@dataclasses.dataclass(frozen=True)
class Script:
    """One flight: what stands, what moves, where the sensor is.

    Attributes:
        geoms: what stands.
        base, velocity: of each mover at time 0 [m], [m/s].
        amplitude, frequency, phase: of its oscillations: (m, h, 3), (m, h), (m, h, 3).
        half: half edges of its box [m].
        round_: whether it is a sphere.
        position: of the sensor at each look [m].
        rotation: sensor frame -> world frame.
    """

    geoms: Geoms
    base: Array3
    velocity: Array3
    amplitude: Float64[np.ndarray, "m h 3"]
    frequency: Float64[np.ndarray, "m h"]
    phase: Float64[np.ndarray, "m h 3"]
    half: Array3
    round_: Bool[np.ndarray, " m"]
    position: Float64[np.ndarray, "t 3"]
    rotation: Float64[np.ndarray, "t 3 3"]

    def at(self, when: float | Float64[np.ndarray, "c 1 1"]) -> tuple[np.ndarray, np.ndarray]:
        """Places [m] and velocities [m/s] of the movers, in float64."""
        angle = self.frequency[..., None] * np.asarray(when)[..., None] + self.phase
        place = self.base + self.velocity * np.asarray(when) + (self.amplitude * np.sin(angle)).sum(-2)
        speed = self.velocity + (self.amplitude * self.frequency[..., None] * np.cos(angle)).sum(-2)
        return place, speed

    def movers(self) -> Movers:
        """The movers as the simulation takes them: spheres first."""
        order = np.argsort(~self.round_, kind="stable")
        count, size = len(order), np.where(self.round_[:, None], self.half[:, :1] * [1.0, 0.0, 0.0], self.half)
        types = tuple(SPHERE if self.round_[i] else BOX for i in order)
        zero = jnp.zeros((count, 3))
        solids = Geoms(zero, jnp.broadcast_to(jnp.eye(3), (count, 3, 3)), _float(size[order]), types)
        flags = jnp.zeros(count, bool)
        motion = (_float(x[order]) for x in (self.amplitude, self.frequency, self.phase))
        knots = (_float(self.base[order])[:, None], _float(self.velocity[order])[:, None])
        place, velocity = knots
        amplitude, frequency, phase = motion
        return Movers(solids, place, velocity, jnp.ones(count), flags, amplitude, frequency, phase, flags)


def _float(values: np.ndarray) -> jax.Array:
    return jnp.asarray(values, jnp.float32)


@jax.jit
def _clearance(geoms: Geoms, points: jax.Array) -> jax.Array:
    return jax.vmap(jax.vmap(distance, (None, 0)), (None, 0))(geoms, points)


def street(name: str, seed: int, count: int, speed: float, looks: int) -> Script:
    """A flight through a city; all movers in free air for its whole time."""
    rng = np.random.default_rng([seed, count, int(speed)])
    geoms = make_scene(name, seed).geoms
    times = _PERIOD * np.arange(looks)
    fine = np.linspace(0.0, times[-1], 24)
    # The way: a street along which the vehicle keeps 2.5 m from all there is.
    while True:
        start = rng.uniform([-70.0, -70.0, 5.0], [70.0, 70.0, 14.0], (256, 3))
        heading = rng.uniform(0.0, 2.0 * np.pi, 256)
        ways = np.stack([_way(a, b, fine) for a, b in zip(start, heading, strict=True)])
        clear = np.asarray(_clearance(geoms, _float(ways))).min(axis=1)
        if clear.max() >= 2.5:
            chosen = int(np.argmax(clear >= 2.5))
            break
    position = _way(start[chosen], heading[chosen], times)
    angles = np.stack([
        heading[chosen] + 0.5 * np.sin(0.5 * times) + 0.3 * np.sin(0.9 * times),
        np.deg2rad(8.0) * np.sin(1.1 * times + 1.0),
        np.deg2rad(10.0) * np.sin(1.7 * times),
    ], axis=1)  # fmt: skip
    rotation = Rotation.from_euler("ZYX", angles).as_matrix()
    parts: list[tuple[np.ndarray, ...]] = []
    while sum(len(p[0]) for p in parts) < count:
        parts.append(_free(rng, geoms, position, speed, fine))
    base, velocity, amplitude, phase, half, round_ = (
        np.concatenate([p[i] for p in parts])[:count] if parts else np.zeros((0, *shape))
        for i, shape in enumerate(((3,), (3,), (1, 3), (1, 3), (3,), ()))
    )
    frequency = np.full((count, 1), 3.0 / speed)
    return Script(geoms, base, velocity, amplitude, frequency, phase, half, round_.astype(bool), position, rotation)


def _way(start: np.ndarray, heading: float, times: np.ndarray) -> Float64[np.ndarray, "t 3"]:
    """Places of a vehicle that turns to and fro."""
    along = _SPEED * times
    aside = 2.0 * (1.0 - np.cos(0.5 * times))
    x, y = np.cos(heading), np.sin(heading)
    climb = 0.5 * np.sin(0.7 * times)
    way: Float64[np.ndarray, "t 3"] = start + np.stack([along * x - aside * y, along * y + aside * x, climb], axis=1)
    return way


def _free(
    rng: np.random.Generator, geoms: Geoms, way: np.ndarray, speed: float, times: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Movers near a way that meet nothing, and never the vehicle by less than 1.5 m."""
    draws = 512
    when = rng.uniform(0.0, times[-1], draws)
    near = np.stack([np.interp(when, _PERIOD * np.arange(len(way)), way[:, k]) for k in range(3)], axis=1)
    middle = near + rng.uniform([-18.0, -18.0, -3.0], [18.0, 18.0, 8.0], (draws, 3))
    heading, climb = rng.uniform(0.0, 2.0 * np.pi, draws), rng.uniform(-0.15, 0.15, draws)
    along = np.stack([np.cos(heading) * np.cos(climb), np.sin(heading) * np.cos(climb), np.sin(climb)], axis=1)
    straight = rng.uniform(size=draws) < 0.5
    velocity = np.where(straight[:, None], speed * along, 0.0)
    frequency = 3.0 / speed
    amplitude = np.where(straight[:, None], 0.0, speed / frequency * along)
    phase = np.repeat(rng.uniform(0.0, 2.0 * np.pi, (draws, 1)), 3, axis=1)
    base = middle - velocity * when[:, None]
    round_ = rng.uniform(size=draws) < 0.5
    half = rng.uniform(0.15, 0.5, (draws, 3))
    half = np.where(round_[:, None], half[:, :1], half)
    angle = frequency * times[None, :, None] + phase[:, None]
    places = base[:, None] + velocity[:, None] * times[:, None] + amplitude[:, None] * np.sin(angle)
    clear = np.asarray(_clearance(geoms, _float(places))).min(axis=1) > 1.0
    vehicle = np.stack([np.interp(times, _PERIOD * np.arange(len(way)), way[:, k]) for k in range(3)], axis=1)
    apart = np.linalg.norm(places - vehicle, axis=2).min(axis=1) > 1.5
    kept = clear & apart & (places[..., 2].min(axis=1) > 1.0)
    return base[kept], velocity[kept], amplitude[kept, None], phase[kept, None], half[kept], round_[kept]


def field(seed: int, obstacles: int, looks: int) -> Script:
    """SANDO's obstacles; the vehicle flies beside them."""
    rng = np.random.default_rng([seed, obstacles])
    moving = int(0.65 * obstacles)
    upright = int(0.35 * (obstacles - moving))
    middle = rng.uniform([5.0, -6.0, 0.5], [100.0, 6.0, 4.5], (obstacles, 3))
    middle[moving : moving + upright, 2] = 2.0
    half = np.tile([0.2, 2.0, 0.2], (obstacles, 1))
    half[:moving], half[moving : moving + upright] = 0.4, [0.2, 0.2, 2.0]
    count = obstacles - moving
    eyes = jnp.broadcast_to(jnp.eye(3), (count, 3, 3))
    still = Geoms(_float(middle[moving:]), eyes, _float(half[moving:]), (BOX,) * count)
    size, scale = rng.uniform(2.0, 4.0, (moving, 3)), rng.uniform(4.0, 6.0, moving)
    offset = rng.uniform(0.0, 3.0, moving)
    times = _PERIOD * np.arange(looks)
    position = np.stack([5.0 + _SPEED * times, np.full(looks, -9.0), 2.5 + 0.5 * np.sin(0.7 * times)], axis=1)
    angles = np.deg2rad(np.stack([20 * np.sin(0.9 * times), 8 * np.sin(1.1 * times), 10 * np.sin(1.7 * times)], axis=1))
    rotation = Rotation.from_euler("ZYX", angles).as_matrix()
    geoms = concatenate([ground_plane(), still])
    motion = (*trefoils(size, offset, scale), half[:moving], np.zeros(moving, bool))
    return Script(geoms, middle[:moving], np.zeros((moving, 3)), *motion, position, rotation)


@dataclasses.dataclass
class Tally:
    """Counts over looks, and what is needed for medians."""

    there: int = 0
    found: int = 0
    tracks: int = 0
    true: int = 0
    swapped: int = 0
    pairs: int = 0
    held: int = 0
    bodies: int = 0
    broken: int = 0
    overflow: int = 0
    looks: int = 0
    place: list[float] = dataclasses.field(default_factory=list)
    velocity: list[float] = dataclasses.field(default_factory=list)
    width: list[float] = dataclasses.field(default_factory=list)
    spread: list[float] = dataclasses.field(default_factory=list)
    since: dict[int, list[float]] = dataclasses.field(default_factory=lambda: {k: [] for k in _SINCE})
    first: list[float] = dataclasses.field(default_factory=list)
    scan: list[float] = dataclasses.field(default_factory=list)
    look: list[float] = dataclasses.field(default_factory=list)


def watch(
    script: Script, sight: TrackingSettings, seed: int, tally: Tally
) -> Iterator[tuple[int, PerceptionState, list[tuple[int, int]]]]:
    """Fly a script; count into the tally; yield look, state, and pairs of slot and mover."""
    movers = script.movers() if len(script.base) else None
    seeing, owner, age = initial_perception(sight), np.full(sight.slots, -1), np.zeros(sight.slots, int)
    first = np.full(len(script.base), np.nan)
    for k in range(len(script.position)):
        now = _PERIOD * (k + 1)
        pose = (_float(script.position[k]), _float(script.rotation[k]))
        moving = None if movers is None else Moving(movers, jnp.float32(now))
        began = time.perf_counter()
        shown = jax.block_until_ready(_scan(script.geoms, sight.lidar, *pose, jax.random.key(1000 * seed + k), moving))
        tally.scan.append(time.perf_counter() - began)
        began = time.perf_counter()
        seeing = jax.block_until_ready(_look(seeing, shown, *pose, jnp.float32(now), sight))
        tally.look.append(time.perf_counter() - began)
        places, velocities = script.at(now)
        returns = _returns(script, np.asarray(shown.points, float), now, sight.lidar)
        away = np.linalg.norm(places - script.position[k], axis=1)
        tracks = seeing.tracks
        confirmed = np.flatnonzero(np.asarray(tracks.confirmed & tracks.used))
        pairs = _paired(tracks, confirmed, places)
        age = np.where(np.isin(np.arange(sight.slots), confirmed), age + 1, 0)
        spread = np.asarray(tracks.fastest - tracks.slowest, float).max(axis=1)
        for looks, values in tally.since.items():
            values += [spread[s] for s, _ in pairs if age[s] == looks + 1]
        first[[j for _, j in pairs if np.isnan(first[j])]] = away[[j for _, j in pairs if np.isnan(first[j])]]
        counts = (returns >= _RETURNS) & (away <= _WITHIN)
        if k >= _FIRST:
            tally.looks += 1
            tally.there += int(counts.sum())
            tally.found += int(counts[[j for _, j in pairs]].sum())
            tally.tracks += len(confirmed)
            tally.true += len(pairs)
            tally.broken += int(np.asarray(seeing.broken).sum())
            tally.overflow += int(seeing.overflow)
            _judge(tally, tracks, pairs, (places, velocities, script.half), counts)
            tally.swapped += sum(owner[s] not in (-1, j) for s, j in pairs)
        owner[~np.asarray(tracks.used)] = -1
        for s, j in pairs:
            owner[s] = j
        yield k, seeing, pairs
    tally.first += first[~np.isnan(first)].tolist()


_scan = jax.jit(scan, static_argnums=1)
_look = jax.jit(process_scan)


def _returns(script: Script, points: np.ndarray, now: float, lidar: Lidar) -> Int[np.ndarray, " m"]:
    """Returns of each mover: points within 0.1 m of its surface or inside."""
    if not len(script.base):
        return np.zeros(0, int)
    columns = np.arange(1, lidar.columns + 1) / lidar.columns - 1.0
    place, _ = script.at(now + lidar.turn * columns[:, None, None])
    offset = points.reshape(lidar.channels, lidar.columns, 1, 3) - place
    box = (np.abs(offset) <= script.half + 0.1).all(-1)
    ball = (offset**2).sum(-1) <= (script.half[:, 0] + 0.1) ** 2
    counts: Int[np.ndarray, " m"] = np.where(script.round_, ball, box).sum((0, 1))
    return counts


def _paired(tracks: Tracks, confirmed: np.ndarray, places: Array3) -> list[tuple[int, int]]:
    if not len(places) or not len(confirmed):
        return []
    low, high, place = (np.asarray(x, float)[confirmed, None] for x in (tracks.low, tracks.high, tracks.place))
    apart = np.linalg.norm(place - places, axis=2)
    held = ((low - 1e-3 <= places) & (places <= high + 1e-3)).all(2)
    cost = np.where(held | (apart < _PAIR), apart, np.inf)
    pairs = []
    while np.isfinite(cost).any():
        s, j = np.unravel_index(np.argmin(cost), cost.shape)
        pairs.append((int(confirmed[s]), int(j)))
        cost[s], cost[:, j] = np.inf, np.inf
    return pairs


def _judge(
    tally: Tally, tracks: Tracks, pairs: list[tuple[int, int]], truth: tuple[Array3, Array3, Array3], counts: np.ndarray
) -> None:
    places, velocities, half = truth
    of = {name: np.asarray(getattr(tracks, name), float) for name in ("low", "high", "half", "place", "velocity")}
    slowest, fastest = np.asarray(tracks.slowest, float), np.asarray(tracks.fastest, float)
    for s, j in pairs:
        tally.pairs += 1
        low, high, body = of["low"][s], of["high"][s], of["half"][s]
        middle = (low - 1e-3 <= places[j]).all() and (places[j] <= high + 1e-3).all()
        box = (low - body <= places[j] - half[j] + 1e-3).all() and (places[j] + half[j] <= high + body + 1e-3).all()
        speed = (slowest[s] - 1e-3 <= velocities[j]).all() and (velocities[j] <= fastest[s] + 1e-3).all()
        tally.held += bool(middle and box and speed)
        tally.bodies += bool(box)
        if counts[j]:
            tally.place.append(float(np.linalg.norm(of["place"][s] - places[j])))
            tally.velocity.append(float(np.linalg.norm(of["velocity"][s] - velocities[j])))
            tally.width.append(float((high - low).max()))
            tally.spread.append(float((fastest[s] - slowest[s]).max()))


def _row(what: Row, tally: Tally) -> Row:
    def share(part: int, whole: int) -> float | None:
        return round(100.0 * part / whole, 2) if whole else None

    def quantile(values: list[float], q: float) -> float | None:
        return round(float(np.quantile(values, q)), 3) if values else None

    def rms(values: list[float]) -> float | None:
        return round(float(np.sqrt(np.mean(np.square(values)))), 3) if values else None

    wrong = tally.there - tally.found + tally.tracks - tally.true + tally.swapped
    return {
        **what,
        "looks": tally.looks,
        "movers": tally.there,
        "recall": share(tally.found, tally.there),
        "precision": share(tally.true, tally.tracks),
        "mota": share(tally.there - wrong, tally.there),
        "place": quantile(tally.place, 0.5),
        "place_rms": rms(tally.place),
        "velocity": quantile(tally.velocity, 0.5),
        "velocity_rms": rms(tally.velocity),
        "held": share(tally.held, tally.pairs),
        "bodies": share(tally.bodies, tally.pairs),
        "width": quantile(tally.width, 0.5),
        "spread": quantile(tally.spread, 0.5),
        **{f"spread_{_PERIOD * k:.1f}_s": quantile(values, 0.5) for k, values in tally.since.items()},
        "first_seen": quantile(tally.first, 0.5),
        "false_tracks": tally.tracks - tally.true,
        "swapped": tally.swapped,
        "broken": tally.broken,
        "overflow": tally.overflow,
        "scan_ms": round(1e3 * float(np.median(tally.scan)), 2),
        "look_ms": round(1e3 * float(np.median(tally.look)), 2),
    }


def main(config: Config) -> list[Row]:
    """Fly all scripts; save and return their rows."""
    lidar = Lidar(channels=config.channels, rays=config.rays)
    rows: list[Row] = []
    for world in config.worlds:
        kinds = [(n, 0.0) for n in config.obstacles] if world == "field" else []
        if world != "field":
            kinds = [(n, v) for n in config.counts for v in (config.speeds if n else config.speeds[:1])]
        for count, speed in kinds:
            dense = TrackingSettings(
                lidar=lidar, bounds=Bounds(2.0, 1.5, 0.8, 0.0), reach=30.0, slots=64, detections=96
            )
            open_ = TrackingSettings(lidar=lidar, bounds=Bounds(8.5, 4.0, 1.0, 0.0))
            sight, tally = dense if world == "field" else open_, Tally()
            for seed in range(config.first, config.first + config.seeds):
                script = (
                    field(seed, count, config.looks)
                    if world == "field"
                    else street(world, seed, count, speed, config.looks)
                )
                for _ in watch(script, sight, seed, tally):
                    pass
            rows.append(_row({"world": world, "count": count, "speed": speed if count and speed else None}, tally))
    save(config.name, config, rows, config.out)
    return rows


def section(document: Document) -> str:
    """RESULTS.md: what is seen of movers."""
    config = document["config"]

    def shown(value: float | None, digits: int) -> str:
        return "" if value is None else f"{value:.{digits}f}"

    lines = []
    for row in document["rows"]:
        lines.append([row["world"], str(row["count"]), shown(row["speed"], 0), str(row["movers"])])
        lines[-1] += [shown(row[name], 1) for name in ("recall", "precision", "mota")]
        lines[-1] += [f"{shown(row[a], 2)} / {shown(row[a + '_rms'], 2)}" for a in ("place", "velocity")]
        lines[-1] += [shown(row["held"], 2), shown(row["bodies"], 2), shown(row["first_seen"], 1)]
        lines[-1] += [str(row["false_tracks"]), str(row["broken"]), f"{row['scan_ms']:.1f} + {row['look_ms']:.1f}"]
    return (
        f"### Seeing movers ({device(document)})\n\n"
        f"A vehicle at 5 m/s that turns and tilts, {config['rays']:,} rays ten times a second; flights of "
        f"{config['looks']} looks, {config['seeds']} a row.\nCounted are movers with five returns or more within 25 m, "
        "a look each; errors are medians and root mean squares.\nHeld: middle, velocity and body in the track's set; "
        "body: its box alone. First: distance of the first confirmed look.\n*field*: SANDO's obstacles, passed at 5 "
        "m/s.\n\n"
        + table(
            ["world", "movers", "m/s", "seen", "recall", "precision", "MOTA", "place [m]", "velocity [m/s]", "held [%]",
             "body [%]", "first [m]", "false", "broken", "scan + look [ms]"],
            lines,
        )
    )  # fmt: skip


if __name__ == "__main__":
    main(configured(TINY))
