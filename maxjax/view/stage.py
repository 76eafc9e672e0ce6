"""From nodes to viser: what changed since the last scene is sent, and nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from maxjax.view.nodes import Ball, Boxes, Dots, Lines, Node, Picture, Scene, Text

if TYPE_CHECKING:
    from viser import SceneApi

# The cube of edge 1 about the origin, each face two triangles seen from outside.
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)], np.float32)
_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ],
    np.uint32,
)
_PLAIN: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


class Stage:
    """A scene of viser that follows scenes of nodes.

    Args:
        scene: of a server.
    """

    def __init__(self, scene: SceneApi) -> None:
        self._scene, self._shown = scene, dict[str, tuple[Node, Any]]()

    def show(self, part: str, nodes: Scene) -> None:
        """Show these nodes in place of all below `part`; nodes that are the same object stay."""
        for name in [name for name in self._shown if _within(name, part) and name not in nodes]:
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
        case Boxes():
            count = len(node.middles)
            return scene.add_batched_meshes_simple(
                name,
                _CORNERS,
                _FACES,
                np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (count, 1)),
                node.middles.astype(np.float32),
                batched_scales=node.sizes.astype(np.float32),
                batched_colors=np.ascontiguousarray(node.colors),
                opacity=None if node.opacity == 1.0 else node.opacity,
                flat_shading=True,
                lod="off",
                **_PLAIN,
            )
        case Lines():
            # A browser takes these colours as linear, and all others as sRGB.
            colors = np.round(255.0 * (node.colors / 255.0) ** 2.2).astype(np.uint8)
            return scene.add_line_segments(
                name, node.points.astype(np.float32), colors, thickness=node.width, thickness_units="screen"
            )
        case Dots():
            points = node.points.astype(np.float32)
            return scene.add_point_cloud(name, points, node.color, point_size=node.size, precision="float32")
        case Picture():
            picture: dict[str, Any] = {"position": node.position, "wxyz": node.turn, "format": "png", **_PLAIN}
            return scene.add_image(name, node.pixels, node.width, node.height, **picture)
        case Ball():
            look: dict[str, Any] = {"opacity": None if node.opacity == 1.0 else node.opacity, "subdivisions": 2}
            return scene.add_icosphere(name, node.radius, node.color, position=node.position, **look, **_PLAIN)
        case Text():
            return scene.add_label(name, node.text, position=node.position, anchor="bottom-center")
