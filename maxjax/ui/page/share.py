"""A page as one file: the viewer, the scene and what plays in it, without any server or network.

.html = viser's viewer + the messages of a scene in time + a caption
"""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np

from maxjax.ui.page.draw import ground_scene
from maxjax.ui.page.nodes import Scene
from maxjax.ui.page.page_map import City
from maxjax.ui.page.server import look_at, serve
from maxjax.ui.page.stage import Stage
from maxjax.ui.page.timeline import VEHICLE_NODE, Film

if TYPE_CHECKING:
    from viser import ViserServer

MOST_BYTES = 10_000_000
_STEP = 0.05  # between two positions of the vehicle [s]
_HOLD = 1.5  # at the end, before it plays again [s]
_BOX = (
    "position:fixed;left:14px;bottom:58px;z-index:10;max-width:22em;padding:10px 14px;border-radius:6px;font:13px/1.45 "
    "system-ui,sans-serif;pointer-events:none;box-shadow:0 1px 6px rgba(0,0,0,.25)"
)


def playing_page(city: City, film: Film, caption: str, *, dark: bool = False) -> str:
    """A film as HTML: it plays by itself, with pause, speed and a slider over its time.

    Args:
        city: the map, for where to look from.
        film: what plays.
        caption: lines of plain text, the first one in bold.
        dark: whether the page is dark.
    """
    server = serve(city, port=0, dark=dark)
    try:
        look_at(server, city, film.positions)
        return _captioned(_recorded(server, film, ground_scene(city, dark=dark), dark), caption, dark)
    finally:
        server.stop()


def _recorded(server: ViserServer, film: Film, ground: Scene, dark: bool) -> str:
    stage = Stage(server.scene)
    stage.show("/", {**film.begin(), **ground})
    serializer, shown = server.get_scene_serializer(), dict[str, Scene]()
    for time in np.arange(0.0, film.duration + _STEP, _STEP).tolist():
        for part, nodes in film.showing(time).items():
            if shown.get(part) is not nodes:
                shown[part] = nodes
                stage.show(part, nodes)
        stage.move(VEHICLE_NODE, film.vehicle(time))
        serializer.insert_sleep(_STEP)
    serializer.insert_sleep(_HOLD)
    return serializer.as_html(dark)


def _captioned(page: str, caption: str, dark: bool) -> str:
    """The page with a title and a caption in its corner."""
    first, *others = (html.escape(line) for line in caption.splitlines() or [""])
    look = "background:rgba(26,27,30,.86);color:#e8e8e8" if dark else "background:rgba(255,255,255,.9);color:#222"
    box = f'<div id="caption" style="{_BOX};{look}"><b>{first}</b>{"".join(f"<br>{line}" for line in others)}</div>'
    start = page.index("<title>") if "<title>" in page else -1
    if start >= 0:
        page = f"{page[:start]}<title>{first}</title>{page[page.index('</title>') + len('</title>') :]}"
    # The last one: the viewer's own program holds the same word.
    end = page.rindex("</body>")
    return page[:end] + box + page[end:]
