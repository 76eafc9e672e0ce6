"""From nodes to viser: what changed since the last scene is sent, and nothing else."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from maxjax.ui.page.gltf import glb
from maxjax.ui.page.nodes import Ball, Dots, Lines, Node, Picture, Scene, Surface, Text

if TYPE_CHECKING:
    from viser import SceneApi

_PLAIN: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


class Stage:
    """A scene of viser that follows scenes of nodes.

    Args:
        scene: of a server.
    """

    def __init__(self, scene: SceneApi) -> None:
        self._scene, self._shown = scene, dict[str, tuple[Node, Any]]()
        self._lock = threading.RLock()  # several threads of a page show their parts

    def show(self, part: str, nodes: Scene) -> None:
        """Show these nodes in place of all below `part`; nodes that are the same object stay."""
        with self._lock:
            # What lies below a node goes before it.
            for name in sorted((n for n in self._shown if _within(n, part) and n not in nodes), reverse=True):
                self._shown.pop(name)[1].remove()
            for name, node in nodes.items():
                if name not in self._shown or self._shown[name][0] is not node:
                    self._shown[name] = node, _add(self._scene, name, node)

    def move(self, name: str, position: tuple[float, float, float]) -> None:
        """Move a node [m]."""
        self._shown[name][1].position = position


def _within(name: str, part: str) -> bool:
    return part == "/" or name == part or name.startswith(f"{part}/")


def _add(scene: SceneApi, name: str, node: Node) -> Any:
    match node:
        case Surface():
            return scene.add_glb(name, glb(node), **_PLAIN)
        case Lines():
            # A browser takes these colours as linear, and all others as sRGB.
            colors = np.round(255.0 * (node.colors / 255.0) ** 2.2).astype(np.uint8)
            return scene.add_line_segments(
                name, node.points.astype(np.float32), colors, thickness=node.width, thickness_units="screen"
            )
        case Dots():
            points = node.points.astype(np.float32)
            form: dict[str, Any] = {"point_shape": "circle", "point_shading": "flat"} if node.round else {}
            return scene.add_point_cloud(name, points, node.color, point_size=node.size, precision="float32", **form)
        case Picture():
            picture: dict[str, Any] = {"position": node.position, "wxyz": node.turn, "format": "png", **_PLAIN}
            return scene.add_image(name, node.pixels, node.width, node.height, **picture)
        case Ball():
            look: dict[str, Any] = {"opacity": None if node.opacity == 1.0 else node.opacity, "subdivisions": 2}
            return scene.add_icosphere(name, node.radius, node.color, position=node.position, **look, **_PLAIN)
        case Text():
            anchor: Any = "top-center" if node.below else "bottom-center"
            return scene.add_label(name, node.text, position=node.position, anchor=anchor)
