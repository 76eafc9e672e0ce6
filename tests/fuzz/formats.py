"""Every format that maxjax reads: a small valid input, and whether it was taken or refused in words of maxjax."""

from __future__ import annotations

import dataclasses
import functools
import io
import json
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np

from maxjax.core.files import FileError
from maxjax.core.serialization import load_pytree, save_pytree
from maxjax.nn.checkpoint import MANIFEST, load_checkpoint, load_metadata, save_checkpoint
from maxjax.sim.trials.ledger import CONFIG, POSITIONS, ROWS, Ledger
from maxjax.sim.trials.outcomes import summarise
from maxjax.ui.cli.options import ViewOptions
from maxjax.ui.cli.view_command import request_shown
from maxjax.ui.page.incoming import fault_of
from maxjax.ui.request_files import load_mission
from tests.fuzz import map_files, zone_samples
from tests.fuzz.mutations import altered, mutated

TREE = {"kernel": np.arange(12, dtype=np.float32).reshape(3, 4), "step": np.int32(7)}
MISSION = """map = "downtown:0"
speed = 8.0
floor = 3
only = ["building"]
return_to_start = true

[[waypoint]]
at = [-75.0, 22.0, 5.0]

[[waypoint]]
at = [0.0, 60.0, 30.0]
hover = 5.0
radius = 1.5
"""
OUTCOME = {"trial": 3, "city": 1, "status": "OK", "start": [1.0, 2.0, 3.0], "goal": [9.0, 8.0, 7.0], "distance": 9.5}
OUTCOME |= {"excluded": 0, "flown_length": 11.2, "duration": 4.1, "clearance": 2.25, "planning_iterations": 6}
OUTCOME |= {"failed_plans": 1, "margins": {"8": 5}, "certified": 1.0, "command": "maxjax fly suburb"}
PLAN = {"map": "downtown:0", "start": [-75.0, 22.0, 5.0], "goal": [0.0, 60.0, 30.0], "speed": 8.0, "only": ["building"]}


@dataclasses.dataclass(frozen=True)
class Format:
    """How one format is tried.

    Attributes:
        valid: an input that is taken.
        outcome: "taken" or "refused" of an input, written into a folder where it is read from one; else it raises.
        damage: makes an input of a valid one.
    """

    valid: Callable[[], bytes]
    outcome: Callable[[bytes, Path], str]
    damage: Callable[[bytes, np.random.Generator], bytes] = mutated


def _of_map(name: str, content: bytes, folder: Path) -> str:
    if not content:
        return "refused"
    (folder / name).write_bytes(content)
    return {"map": "taken"}.get(found := map_files.outcome(folder / name), found)


def _read(read: Callable[[], Any]) -> str:
    """What a reader gives is finite; what it raises is its own sentence, and no error of a library."""
    try:
        found = read()
    except ValueError as error:
        _check_sentence(error)
        return "refused"
    _check_finite(found)
    return "taken"


def _check_sentence(error: ValueError) -> None:
    assert type(error) in (ValueError, FileError), error
    assert "\n" not in str(error)
    assert len(str(error)) < 1000


def _check_finite(value: Any) -> None:
    match value:
        case float():
            assert math.isfinite(value)
        case dict():
            for one in value.values():
                _check_finite(one)
        case list() | tuple():
            for one in value:
                _check_finite(one)


def _mission(content: bytes, folder: Path) -> str:
    (folder / "a.toml").write_bytes(content)
    return _read(lambda: [dataclasses.astuple(one) for one in load_mission(folder / "a.toml").waypoints])


def _ledger(name: str, content: bytes, folder: Path) -> str:
    (folder / CONFIG).write_bytes(_config())
    (folder / name).write_bytes(content)
    found = _read(lambda: _campaign(Ledger.read(folder)))
    (folder / ROWS).unlink(missing_ok=True)
    return found


def _campaign(ledger: Ledger) -> Any:
    """What is made of a ledger: its statistics, and what it is resumed with."""
    return summarise(list(ledger.outcomes.values())), ledger.batch


def _positions(content: bytes, folder: Path) -> str:
    (folder / CONFIG).write_bytes(_config())
    (folder / ROWS).write_bytes(_rows())
    (folder / POSITIONS).mkdir(exist_ok=True)
    (folder / POSITIONS / "000003.npz").write_bytes(content)
    return _read(lambda: [flown.tolist() for flown in Ledger.read(folder).positions().values()])


def _placed() -> bytes:
    content = io.BytesIO()
    np.savez_compressed(content, trial=np.array([3]), position=np.zeros((1, 4, 3), np.float32))
    return content.getvalue()


def _plan_file(content: bytes, folder: Path) -> str:
    (folder / "plan.json").write_bytes(content)
    return _read(lambda: dataclasses.astuple(request_shown(ViewOptions(str(folder / "plan.json")))))


def _config() -> bytes:
    return b'{"campaign": {"map": "suburb", "seed": 0, "first": 0, "trials": 9}, "batch": 4, "flown_by": []}'


def _rows() -> bytes:
    return 2 * (msgspec.json.encode(OUTCOME) + b"\n")


@functools.cache
def _whole_files() -> dict[str, bytes]:
    """Weights, and the files of a checkpoint, by name."""
    with tempfile.TemporaryDirectory() as folder:
        save_pytree(Path(folder, "weights.npz"), TREE)
        save_checkpoint(folder, TREE, 1, {"rate": 0.1})
        return {file.name: file.read_bytes() for file in Path(folder).iterdir()}


def _restored(name: str, content: bytes, folder: Path) -> str:
    for file, whole in (_whole_files() | {name: content}).items():
        (folder / file).write_bytes(whole)
    if name == "weights.npz":
        return _read(lambda: load_pytree(folder / name, TREE) and None)
    return _read(lambda: load_metadata(folder) and load_checkpoint(folder, TREE) and None)


def _control(value: Any, **props: Any) -> Any:
    return SimpleNamespace(_impl=SimpleNamespace(value=value, props=SimpleNamespace(**props)))


CONTROLS = {
    "band": _control((5.0, 60.0), min=0.0, max=150.0, step=1.0),
    "radius": _control(1.0, min=0.0, max=30.0, step=0.25),
    "method": _control("field", options=("field", "astar")),
}
DRAG = {"type": "TransformControlsUpdateMessage", "name": "/start", "wxyz": (1.0, 0.0, 0.0, 0.0), "owner": ""}
MESSAGES = {
    "message of a slider": {"type": "GuiUpdateMessage", "uuid": "radius", "updates": {"value": 3.5}},
    "message of a range": {"type": "GuiUpdateMessage", "uuid": "band", "updates": {"value": [7.0, 41.0]}},
    "message of a choice": {"type": "GuiUpdateMessage", "uuid": "method", "updates": {"value": "astar"}},
    "message of a drag": DRAG | {"position": (1.0, 2.0, 3.0)},
}


def _message(content: bytes, folder: Path) -> str:
    fault = fault_of(content, CONTROLS)
    assert "\n" not in fault
    assert len(fault) < 300
    if fault:
        return "refused"
    _check_finite(msgspec.msgpack.decode(content))
    return "taken"


def _damaged_zones(content: bytes, rng: np.random.Generator) -> bytes:
    """Every other file of JSON stays one: most of what is changed within it is read."""
    if content[:1] in b"{[" and rng.random() < 0.5:
        return json.dumps(altered(json.loads(content), rng)).encode()
    return mutated(content, rng)


def share(name: str, inputs: int) -> int:
    """How many of so many inputs of all formats are of this one: fewer where each takes longer."""
    return math.ceil(inputs / len(FORMATS) / SLOW.get(name, 1))


SLOW = {
    "scene.xml": 10,
    "a.zip": 4,
    **dict.fromkeys(("a.xyz", "a.gltf", "a.fgb", "a.e57"), 4),
    **dict.fromkeys(("a.asc", "a.osm.pbf"), 8),
    "a.gpkg": 30,
    **dict.fromkeys(zone_samples.SAMPLES, 3),
}  # formats that take so many times as long as others
FORMATS = {name: Format(valid, functools.partial(_of_map, name)) for name, valid in map_files.SAMPLES.items()}
for _name in zone_samples.SAMPLES:
    FORMATS[_name] = dataclasses.replace(FORMATS[_name], damage=_damaged_zones)
FORMATS |= {
    "mission.toml": Format(MISSION.encode, _mission),
    CONFIG: Format(_config, functools.partial(_ledger, CONFIG)),
    ROWS: Format(_rows, functools.partial(_ledger, ROWS)),
    "positions.npz": Format(_placed, _positions),
    "plan.json": Format(lambda: msgspec.json.encode({"configuration": PLAN}), _plan_file),
}
for _name in ("weights.npz", MANIFEST, "state-00000001-0.npz"):
    FORMATS[_name] = Format(
        functools.partial(lambda name: _whole_files()[name], _name), functools.partial(_restored, _name)
    )
for _name, _content in MESSAGES.items():
    FORMATS[_name] = Format(functools.partial(msgspec.msgpack.encode, _content), _message)
