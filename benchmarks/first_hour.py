"""How long a newcomer takes from a clone to a mission over a city of one's own, each command as README.md has it.

    MAXJAX_DATA=... python -m benchmarks.first_hour     # two CPU cores: 3 minutes

A clone of this commit in an empty folder, a home without caches, nothing but Python, make and a package index. The
commands are those of README's "Two commands", without the tests, and of "A mission in three commands"; then these once
more, as it says below them, with another file and other waypoints in a copy of the round.
"""

from __future__ import annotations

import dataclasses
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, save

_ROOT = Path(__file__).parents[1]
_SAMPLE = "docs/samples/quarter.geojson"
_ROUND = "docs/samples/round.toml"
# What a newcomer has: ways to programs and to the package index, and no cache of JAX's, of pip's or of maxjax's.
_PASSED = re.compile(r"PATH|LANG|LC_.*|TMPDIR|PIP_.*|.*_proxy|.*_PROXY|SSL_.*|REQUESTS_CA_BUNDLE")


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        install: whether a clone installs itself, and runs the demo; else what is installed here is used.
        data: folder with the city.
        city: a file in it; None: no city of one's own.
        crs: its reference system, which it does not name.
        waypoints: in that system, as many as the sample's round has [m].
        out: where the JSON goes.
    """

    install: bool = True
    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    city: Path | None = Path("the_hague/DenHaag_01.city.json")
    crs: str = "EPSG:28992"
    waypoints: tuple[tuple[float, float, float], ...] = (
        (78450.0, 458150.0, 12.0),
        (78440.0, 458010.0, 20.0),
        (78700.0, 457850.0, 12.0),
    )
    out: Path = RESULTS


TINY = Config(install=False, city=None)


def main(config: Config) -> list[Row]:
    """Run what a newcomer types; save and return the rows.

    Raises:
        subprocess.CalledProcessError: for a command that fails; what it said is on stderr.
        FileNotFoundError: for a city that is not there.
    """
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        clone, home = Path(folder) / "maxjax", Path(folder) / "home"
        home.mkdir()
        here = {name: value for name, value in os.environ.items() if _PASSED.fullmatch(name)} | {"HOME": str(home)}
        # As after `export PATH=…` in README; what is installed here stands in for a clone that does not install itself.
        programs = clone / ".venv" / "bin" if config.install else Path(sys.executable).parent
        here["PATH"] = f"{programs}{os.pathsep}{here['PATH']}"

        def run(*words: str, shown: str | None = None, within: Path = clone) -> None:
            started = time.perf_counter()
            subprocess.run(words, check=True, cwd=within, env=here, stdout=subprocess.DEVNULL)
            seconds = round(time.perf_counter() - started, 1)
            rows.append({"what": shown or shlex.join(words), "unit": "s", "median": seconds, "n": 1})

        run("git", "clone", "--quiet", str(_ROOT), str(clone), shown="git clone", within=home)
        lines = commands((clone / "README.md").read_text(encoding="utf-8"))
        for words in lines if config.install else lines[1:]:
            run(*words)
        if config.city is not None:
            city = (config.data / config.city).resolve()
            (clone / city.name).write_bytes(city.read_bytes())
            text = (clone / _ROUND).read_text(encoding="utf-8")
            (clone / "city.toml").write_text(own_round(text, city.name, config.crs, config.waypoints), encoding="utf-8")
            for words in lines[1:]:
                run(*(_own(word, city.name) for word in words))
    rows.append(
        {"what": "all", "unit": "s", "median": round(sum(float(row["median"] or 0) for row in rows), 1), "n": 1}
    )
    save("first_hour", config, rows, config.out)
    return rows


def commands(readme: str) -> list[list[str]]:
    """`make demo` and the commands of the mission, from README's blocks of commands."""
    first, second, *_ = re.findall(r"^```bash\n(.*?)^```$", readme, re.MULTILINE | re.DOTALL)
    words = [shlex.split(line, comments=True) for line in (first + second).splitlines()]
    return [line for line in words if line != ["make", "test"]]


def own_round(text: str, city: str, crs: str, waypoints: tuple[tuple[float, float, float], ...]) -> str:
    """A copy of the sample's round with another map, its reference system and other waypoints."""
    places = iter(waypoints)
    text = re.sub(r"^at = .*$", lambda _: f"at = {list(next(places))}", text, flags=re.MULTILINE)
    return re.sub(r"^map = .*$", f'map = "{city}"\\ncrs = "{crs}"', text, flags=re.MULTILINE)


def _own(word: str, city: str) -> str:
    return {_SAMPLE: city, _ROUND: "city.toml"}.get(word, word.replace("quarter", "city"))


if __name__ == "__main__":
    main(configured(TINY))
