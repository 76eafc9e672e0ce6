"""What is no regular file is refused by all that read a user's file: nothing hangs, nothing reads without end."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from maxjax.core.files import FileError, open_regular, open_to_append, read_bytes
from maxjax.core.grid import Grid
from maxjax.core.serialization import load_metadata, read_npz
from maxjax.io.airspace.zone_files import load_airspace
from maxjax.io.geo.earth import TangentPlane
from maxjax.io.reader import READERS, read_map
from maxjax.io.reading import PLAIN
from maxjax.nn import checkpoint
from maxjax.nn.model import load_model
from maxjax.sim.trials.ledger import CONFIG, POSITIONS, ROWS, Ledger
from maxjax.ui.cli.options import ViewOptions
from maxjax.ui.cli.view_command import request_shown
from maxjax.ui.request_files import load_mission

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of POSIX")

GRID = Grid((8, 8, 8), 2.0, (0.0, 0.0, 0.0))


def mission(path: Path) -> object:
    return load_mission(path)


def airspace(path: Path) -> object:
    return load_airspace(path, TangentPlane(48.0, 11.0, 500.0), GRID)


def of_campaign(path: Path) -> object:
    """A folder whose file of this name is the one to be read."""
    folder = path.parent / "campaign"
    folder.mkdir()
    if path.stem != "config":
        (folder / CONFIG).write_text('{"campaign": {}}')
    (folder / {"config": CONFIG, "rows": ROWS}[path.stem]).symlink_to(path)
    return Ledger.read(folder)


def manifest(path: Path) -> object:
    (path.parent / checkpoint.MANIFEST).symlink_to(path)
    return checkpoint.load_metadata(path.parent)


DOORS: dict[str, Callable[[Path], object]] = {
    "mission.toml": mission,
    "areas.geojson": airspace,
    "config.json": of_campaign,
    "rows.jsonl": of_campaign,
    "weights.npz": lambda path: load_model("maxjax", path),
    "pytree.npz": load_metadata,
    "arrays.npz": read_npz,
    "manifest.json": manifest,
    "any": read_bytes,
    "map.ply": read_map,
    "map.json": read_map,
    # The readers themselves, too: a name may change between the gate and them.
    **{
        f"read{suffix}": lambda path, read=read: read(path, PLAIN)
        for suffix, read in READERS.items()
        if suffix not in (".tif", ".tiff", ".zip")
    },
}


@pytest.fixture(autouse=True)
def _soon() -> Iterator[None]:
    """What hangs fails."""

    def late(*_: object) -> None:
        raise TimeoutError("it hangs")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(10)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("name", DOORS)
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_no_reader_takes_what_is_no_file(name: str, kind: str, tmp_path: Path) -> None:
    path = tmp_path / name
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
        if name.startswith("map"):
            pytest.skip("a folder may be a map")
    with pytest.raises(FileError, match=rf"expected a (regular file|file or a folder), found a {kind}|found a device"):
        DOORS[name](path)


def test_view_leaves_it_to_the_reader_of_maps(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "plan.json")
    assert request_shown(ViewOptions(str(tmp_path / "plan.json"))).waypoints == ()
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    with pytest.raises(FileError, match="expected a regular file, found a device"):
        request_shown(ViewOptions(str(tmp_path / "zero.toml")))


def test_what_is_too_large_or_missing_is_refused_with_its_name(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(bytes(101))
    assert read_bytes(path, 101) == bytes(101)
    with pytest.raises(FileError, match=r"a: 101 bytes, expected at most 100"):
        read_bytes(path, 100)
    with pytest.raises(FileError, match=r"missing: cannot be read: No such file"):
        read_bytes(tmp_path / "missing")
    with pytest.raises(FileError, match="cannot be read: embedded null"):
        read_bytes(Path("a\0b"))
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "s"))
        with pytest.raises(FileError, match="expected a regular file, found a socket"):
            read_bytes(tmp_path / "s")


def test_a_file_that_tells_no_size_is_read_within_the_bound() -> None:
    if not Path("/proc/self/maps").exists():
        pytest.skip("no file here has content and no size")
    with pytest.raises(FileError, match="more than 100 bytes"):
        read_bytes(Path("/proc/self/maps"), 100)


def test_an_error_of_who_reads_goes_through(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"a")
    with pytest.raises(ValueError, match=r"^mine$"), open_regular(tmp_path / "a"):
        raise ValueError("mine")


def test_keys_of_many_parts_are_refused_before_they_are_parsed(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    for key in (".".join(["a"] * 20_000), " . ".join(['"="'] * 20_000), "[" + ".".join(["a"] * 20_000) + "]"):
        path.write_text(key + " = 1\n" if key[0] != "[" else key + "\n")
        with pytest.raises(ValueError, match="expected keys of at most 64 parts"):
            mission(path)


def test_texts_may_hold_as_many_dots_as_they_like(tmp_path: Path) -> None:
    path = tmp_path / "dots.toml"
    path.write_text(f'map = "{"." * 1000}"\nnothing = 1\n')
    with pytest.raises(ValueError, match="nothing"):
        mission(path)


@pytest.mark.parametrize("name", ["lock", ROWS])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_nothing_is_appended_to_what_is_no_file(tmp_path: Path, name: str, kind: str) -> None:
    ledger = Ledger(tmp_path, {})
    path = tmp_path / name
    {"pipe": os.mkfifo, "device": lambda path: path.symlink_to("/dev/zero"), "folder": os.mkdir}[kind](path)
    with (
        pytest.raises(FileError, match=f"{name}: cannot be (read|written): expected a regular file, found a {kind}"),
        ledger.held(),
    ):
        pass
    with pytest.raises(FileError, match=f"expected a regular file, found a {kind}"), open_to_append(path):
        pass


def test_lines_are_appended_behind_those_that_are_there(tmp_path: Path) -> None:
    for line in (b"a\n", b"b\n"):
        with open_to_append(tmp_path / "rows") as file:
            file.write(line)
    assert (tmp_path / "rows").read_bytes() == b"a\nb\n"


SHRINKING = """
import os, sys
from pathlib import Path
from maxjax.io.readers import ply
path, whole = Path(sys.argv[1]), ply._read_header

def header(*given):
    found = whole(*given)
    os.truncate(path, 0)
    return found

ply._read_header = header
print(len(ply.load_ply(path).points))
"""


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_a_ply_that_shrinks_while_it_is_read_ends_no_process(tmp_path: Path, order: str) -> None:
    path, count = tmp_path / "a.ply", 100_000
    rows = np.random.default_rng(0).uniform(0.0, 9.0, (count, 3)).astype("<f4")
    head = f"ply\nformat {order} 1.0\nelement vertex {count}\n" + "".join(f"property float {x}\n" for x in "xyz")
    body = rows.tobytes() if order != "ascii" else "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode()
    path.write_bytes(f"{head}end_header\n".encode() + body)
    done = subprocess.run([sys.executable, "-c", SHRINKING, str(path)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, f"{count}\n"), done.stderr
    assert path.stat().st_size == 0


def test_a_list_of_positions_is_a_lost_position_and_no_traceback(tmp_path: Path) -> None:
    (tmp_path / POSITIONS).mkdir()
    os.mkfifo(tmp_path / POSITIONS / "000000.npz")
    with pytest.raises(FileError, match="found a pipe"):
        list(Ledger(tmp_path, {}).batches())
