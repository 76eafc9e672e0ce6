"""Licences of what maxjax stands on, as the installed distributions state them: `python docs/site/licences.py`."""

from __future__ import annotations

import dataclasses
import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution, requires

from packaging.requirements import Requirement

USERS = ("viz", "las", "e57", "geotiff", "gis", "ros", "view")
"""Extras of users; the others are for benchmarks, tests and documentation."""

PERMISSIVE = re.compile(
    r"\b(MIT|BSD|Apache|ISC|0BSD|Zlib|CC0|PSF|Python Software Foundation|Public Domain|any-OSI|MPL|Mozilla)\b", re.I
)
"""Of MPL, changes to its own files alone must be published."""

COPYLEFT = re.compile(r"\b[AL]?GPL|GNU\b")


@dataclasses.dataclass(frozen=True)
class Stated:
    """A distribution and its licence, in its own words; `users` where one of `USERS` or maxjax itself asks for it."""

    name: str
    licence: str
    users: bool


def found() -> list[Stated]:
    """What is installed of all that maxjax asks for, directly or not, by name."""
    wanted = [Requirement(text) for text in requires("maxjax") or []]
    of_users = _installed([one for one in wanted if any(_asked(one, extra) for extra in ("", *USERS))])
    rest = _installed([one for one in wanted if one.name != "maxjax"])
    return [Stated(name, _licence(one), name in of_users) for name, one in sorted(rest.items())]


def table() -> str:
    """The same as Markdown."""
    head = ["| package | licence, as it states it | for |", "| --- | --- | --- |"]
    return "\n".join(head + [f"| {one.name} | {one.licence} | {_purpose(one)} |" for one in found()])


def _purpose(one: Stated) -> str:
    return "users" if one.users else "development"


def _asked(wanted: Requirement, extra: str) -> bool:
    return wanted.marker is None or wanted.marker.evaluate({"extra": extra})


def _installed(wanted: list[Requirement]) -> dict[str, Distribution]:
    """These and what they ask for in turn; what is not installed is left out."""
    known: dict[str, Distribution] = {}
    done: set[str] = set()
    while wanted:
        one = wanted.pop()
        if str(one) in done:
            continue
        done.add(str(one))
        try:
            there = distribution(one.name)
        except PackageNotFoundError:
            continue
        known[re.sub(r"[-_.]+", "-", one.name).lower()] = there
        further = map(Requirement, there.requires or [])
        wanted += [each for each in further if any(_asked(each, extra) for extra in ("", *one.extras))]
    return known


def _licence(one: Distribution) -> str:
    """Its expression, else its classifiers, else the first line of its text."""
    named = one.metadata.get("License-Expression")
    classes = [
        text.split(" :: ")[-1] for text in one.metadata.get_all("Classifier") or [] if text.startswith("License")
    ]
    classes = [text for text in classes if text != "OSI Approved"]
    text = (one.metadata.get("License") or "").strip().partition("\n")[0]
    return named or ", ".join(classes) or text or "not stated"


if __name__ == "__main__":
    print(table())
