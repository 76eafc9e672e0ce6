"""The look of all figures (extra `viz`): colours, fonts, and files that are equal where figures are equal.

Paths have the Okabe-Ito colours, which the colour-blind tell apart, and line styles that remain in black and
white. Figures are plain objects: nothing here touches pyplot's global state.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maxjax.core.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PATHS: tuple[tuple[str, Any], ...] = (
    ("#D55E00", "-"),
    ("#0072B2", (0, (4, 1.5))),
    ("#009E73", (0, (1.2, 1.0))),
    ("#CC79A7", (0, (5, 1.4, 1.2, 1.4))),
    ("#E69F00", (0, (8, 2))),
    ("#56B4E9", (0, (3, 1, 1.2, 1, 1.2, 1))),
)
HEIGHTS = ("#E4E4E4", "#484848")
CLEARANCES = "plasma"  # readable to the colour-blind, and in black and white
FIELD = "#6FA3CC"
RETURN = "#222222"
ARRIVED, FAILED, PLANNED, KNOWN, GOAL = "#0072B2", "#D55E00", "#009E73", "#56B4E9", "#F0E442"
MOVER, MOTION, FLAGGED = "#7A1EA0", "#CC79A7", "#E69F00"
CLOSED = "#B03A2E"
EARTH, BESIDE, OBSTACLE = "#D3BE94", "#E4E4E4", "#8A8A8A"
UNKNOWN, UNKNOWN_MARKS = "#ECE7F4", "#A79BC0"  # outside the data
CLOSED_AIR = "#F2B8B0"  # in section
STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "pdf.fonttype": 42,  # editable text
    "svg.hashsalt": "maxjax",  # equal figures, equal files
}
_METADATA: dict[str, dict[str, None]] = {".pdf": {"CreationDate": None}, ".png": {}, ".svg": {"Date": None}}


def load_matplotlib() -> tuple[Callable[[Any], contextlib.AbstractContextManager[None]], Callable[..., Figure]]:
    """`rc_context` and the class of figures.

    Raises:
        ImportError: if matplotlib is missing; names the extra.
    """
    # Where the home cannot be written, it warns that it will look for fonts anew.
    log = logging.getLogger("matplotlib")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        from matplotlib import rc_context
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("figures need the extra viz: pip install 'maxjax[viz]'") from error
    finally:
        log.setLevel(level)
    return rc_context, Figure


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure atomically, as .pdf, .png (200 dots an inch) or .svg by the suffix.

    Raises:
        ValueError: for another suffix.
        OSError: if the file cannot be written.
    """
    from matplotlib import rc_context

    suffix = Path(path).suffix.lower()
    if suffix not in _METADATA:
        raise ValueError(f"{path}: expected a suffix among {', '.join(_METADATA)}, given {suffix or 'none'}")
    buffer = io.BytesIO()
    with rc_context(STYLE):
        figure.savefig(buffer, format=suffix[1:], dpi=200, metadata=_METADATA[suffix])
    atomic_write(path, buffer.getvalue())
