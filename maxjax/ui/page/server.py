"""The server of a page: viser's, without what leads out of this machine.

It serves its own page and the messages of one scene, to whom `border` lets in, and takes what `incoming` lets pass. It
opens no tunnel, takes no uploads, reads no file that a browser names, and listens on this machine alone unless another
address is asked for.
"""

from __future__ import annotations

import contextlib
import io
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from maxjax.ui.page.border import Border
from maxjax.ui.page.camera import NARROW, SHEET, above_sheet, over_map, over_way
from maxjax.ui.page.guard import guarding
from maxjax.ui.page.nodes import point3
from maxjax.ui.page.page_map import City

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

LOOPBACK = "127.0.0.1"
PORT = 8080
# On a telephone viser's panel is a sheet over the lower part of the window: lower than its own 60 %, so that what is
# planned is seen above it, and as wide as the window. It scrolls, and a touch of its head folds it.
_FIXED = '[style*="position: fixed"][style*="max-height: 60%"]'
_LOW_SHEET = (
    f"<style>{_FIXED} {{max-height: {SHEET:.0%} !important; width: 100% !important}}"
    f' {_FIXED} [style*="width: 20em"] {{width: 100% !important}}</style>'
)


def need_viser() -> None:
    """Find out whether viser is there.

    Raises:
        ImportError: if it is missing; names the extra.
    """
    try:
        import viser  # noqa: F401
    except ImportError as error:
        raise ImportError("the page needs the extra view: pip install 'maxjax[view]'") from error


def serve(city: City, *, host: str = LOOPBACK, port: int = PORT, dark: bool = False) -> ViserServer:
    """A server with an empty scene, lit and looked at as suits a map; `address_of` tells where.

    Args:
        city: the map.
        host: address to listen on.
        port: to listen on; where it is taken, the next free one.
        dark: whether the page is dark.

    Raises:
        ImportError: without viser, or with one that cannot be guarded.
        OSError: if the address cannot be listened on.
    """
    need_viser()
    check_host(host, port)
    server: ViserServer = _server_class()(Border.of(host), host=host, port=port, label=city.name)
    set_theme(server, dark=dark)
    scene = server.scene
    # No image-based light and no shadows: they cost most of a frame where there is no GPU, and tell nothing of a map.
    scene.configure_environment_map(hdri=None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere("/light/sky", sky_color=(255, 255, 255), ground_color=(150, 140, 125), intensity=1.9)
    scene.add_light_directional("/light/sun", intensity=1.7, position=(-0.5, -0.8, 1.2), cast_shadow=False)
    look_at(server, city)
    server.on_client_connect(lambda client: aim(server, client))
    server.gui.add_html(_LOW_SHEET)
    return server


def address_of(server: ViserServer) -> str:
    """Where a browser finds the page; with a token, unless the server listens on this machine alone."""
    border: Border = server.border
    return border.address(server.get_port())


def set_theme(server: ViserServer, *, dark: bool) -> None:
    """The page's colours; nothing on it leads to other machines."""
    server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False, control_width="medium")


def look_at(server: ViserServer, city: City, points: Float[np.ndarray, "n 3"] | None = None) -> None:
    """Look at the map or at a way in it from above, for browsers that come from now on.

    Args:
        server: of the page.
        city: the map.
        points: of the way, in the page's frame [m]; None: the whole map.
    """
    camera = server.initial_camera
    camera.position, camera.look_at = over_map(city) if points is None else over_way(city, points)
    server.way = points
    camera.far = 20.0 * city.grid.spacing * max(city.grid.shape[:2])


def aim(server: ViserServer, client: ClientHandle) -> None:
    """Let a browser that is there look at what `look_at` said last; on a telephone above its panel."""
    first, camera = server.initial_camera, client.camera
    eye, target = point3(np.asarray(first.position)), point3(np.asarray(first.look_at))
    way: Float[np.ndarray, "n 3"] | None = server.way
    if camera.image_width < NARROW and way is not None:
        high = 2.0 * float(np.tan(0.5 * camera.fov))
        eye, target = above_sheet(eye, target, way, (high, high * camera.aspect))
    camera.position, camera.look_at = eye, target


def check_host(host: str, port: int) -> None:
    """Find out whether an address can be listened on, which viser's own thread would not tell.

    Raises:
        OSError, ValueError: if it cannot.
    """
    import socket

    if not 0 <= port < 2**16:
        raise ValueError(f"--port: expected 0 to 65535, given {port}")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
    except OSError as error:
        raise OSError(f"--host {host}: cannot be listened on: {error.strerror or error}") from error


def _server_class() -> Any:
    import viser

    class Local(viser.ViserServer):
        """A server that a browser cannot ask to be reached from the internet, and that prints nothing."""

        def __init__(self, border: Border, **settings: Any) -> None:
            self.border = border
            self.way: Float[np.ndarray, "n 3"] | None = None
            """The way to look at, in the page's frame [m]; None: the whole map."""
            with contextlib.redirect_stdout(io.StringIO()), guarding(border, self._controls, self.tell):
                super().__init__(verbose=False, **settings)

        def _controls(self) -> dict[str, Any]:
            gui = self.__dict__.get("gui")  # which it has not while it starts
            return {} if gui is None else gui._gui_input_handle_from_uuid

        def tell(self, sentence: str) -> None:
            """Show a sentence in every browser."""
            for client in self.get_clients().values():
                client.add_notification("Not taken", sentence, color="orange", auto_close_seconds=8.0)

        def request_share_url(self, verbose: bool = True) -> str | None:
            """None: the page stays on this machine."""
            return None

    return Local
