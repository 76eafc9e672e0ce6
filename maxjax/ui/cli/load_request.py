"""The map of a request, read with progress shown and remarks told."""

from __future__ import annotations

from pathlib import Path

from maxjax.ui.cli.map_task import MapTask, load_source, task_in
from maxjax.ui.cli.progress import progress
from maxjax.ui.cli.report import complain
from maxjax.ui.request import Request, reading_of


def load_request(request: Request) -> MapTask:
    """The task of a request, checked, in the map that it names; what a user should know of the map goes to stderr.

    Raises:
        ValueError, OSError, ImportError: as `Request.check`, `load_source` and `task_in`.
    """
    request.check()
    with progress(f"Reading {request.map}"):
        given = task_in(load_source(request.map, reading_of(request)), request)
    tell_notes(request)
    tell_remarks(request.map, given)
    return given


def tell_notes(request: Request) -> None:
    """Say on stderr what a user should know of the files that a request was made of."""
    for note in request.notes:
        complain(f"Note: {note}.")


def tell_remarks(file: str, given: MapTask) -> None:
    """Say on stderr what a user should know of a map."""
    for remark in given.remarks:
        complain(f"Note: {Path(file).name}: {remark}.")
