"""Figure 3: both networks, from their configurations."""

from __future__ import annotations

import dataclasses
import functools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax

from experiments.differentiable.field import COLORS, figure
from maxjax.nn import layers
from maxjax.nn.architecture import CONFIGS, Autoencoder
from maxjax.nn.autoencoder import init_params

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclasses.dataclass(frozen=True)
class Volume:
    """Features between two layers: what made them, their channels, the voxels along an edge."""

    made_by: str
    channels: int
    voxels: int
    level: int


_ARROW: Any = {"arrowstyle": "-|>", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 6, "color": "black"}
_KEPT: Any = {"color": "#666666", "linewidth": 0.8, "linestyle": (0, (3, 1.5))}
_LAYERS = {
    "input": "#E4E4E4",
    "convolution, ReLU": COLORS[1],
    "max-pooling": COLORS[4],
    "upsampling": COLORS[2],
    "head": COLORS[3],
}


def volumes_of(network: Autoencoder, voxels: int = 101) -> list[Volume]:
    """What a network computes, in order: the layers of its encoder, its decoder and its head."""
    spaces = [space[0] for space in network.spaces((voxels,) * network.dimensions)]
    inputs = network.inputs * network.channels
    found = [Volume("input", inputs, spaces[0], 0)]
    for level, channels in enumerate(network.encoder):
        found += [Volume("convolution, ReLU", c, spaces[level], level) for c in channels]
        found.append(Volume("max-pooling", channels[-1], spaces[level + 1], level + 1))
    for level, channels in zip(reversed(range(len(network.encoder))), network.decoder, strict=True):
        kept = network.encoder[level][-1] if network.skips else 0
        found.append(Volume("upsampling", found[-1].channels + kept, spaces[level], level))
        found += [Volume("convolution, ReLU", c, spaces[level], level) for c in channels]
    return [*found, Volume("head", network.channels, spaces[0], 0)]


def weights_of(network: Autoencoder) -> int:
    """Number of weights, without drawing them."""
    shapes = jax.eval_shape(functools.partial(init_params, config=network), jax.random.key(0))
    return layers.count(shapes)


def draw_architecture(file: Path) -> Path:
    """The paper's network and maxjax's, each volume a box: its height the voxels of an edge, its width the channels."""
    with figure(file, 9.6, 5.6) as drawn:
        for row, (name, title) in enumerate((("paper", "the paper's network"), ("maxjax", "maxjax's network"))):
            axes = drawn.add_axes((0.01, 0.53 - 0.47 * row, 0.98, 0.42))
            network = CONFIGS[name]
            _draw_network(axes, network)
            kept = ", encoder features kept for the decoder" if network.skips else ""
            patch = f", blocks of {network.patch}³ voxels as channels" if network.patch > 1 else ""
            kernels = "·".join(f"{k}³" for k in sorted(set(network.kernels)))
            text = f"{title}: {weights_of(network):,} weights, kernels {kernels}{patch}{kept}"
            axes.set_title(text, fontsize=9, loc="left")
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch

        handles: list[Any] = [
            Patch(facecolor=color, edgecolor="black", linewidth=0.5, label=name) for name, color in _LAYERS.items()
        ]
        handles.append(Line2D([], [], label="kept for the decoder", **_KEPT))
        drawn.text(0.5, 0.055, "above each box: voxels; below: channels", ha="center", fontsize=8)
        drawn.legend(handles=handles, loc="lower center", ncols=len(handles), borderaxespad=0.0)
    return file


def _draw_network(axes: Axes, network: Autoencoder) -> None:
    from matplotlib.patches import Rectangle

    volumes = volumes_of(network)
    gap, x = 0.62, 0.0
    placed: list[tuple[float, float]] = []
    tallest = max(volume.voxels for volume in volumes)
    for volume in volumes:
        width, height = 0.045 * math.sqrt(volume.channels) + 0.06, 0.12 + volume.voxels / tallest
        axes.add_patch(
            Rectangle(
                (x, -height / 2), width, height, facecolor=_LAYERS[volume.made_by], edgecolor="black", linewidth=0.5
            )
        )
        axes.text(x + width / 2, -height / 2 - 0.03, str(volume.channels), ha="center", va="top", fontsize=6.5)
        axes.text(x + width / 2, height / 2 + 0.03, f"{volume.voxels}³", ha="center", va="bottom", fontsize=6.5)
        if placed:
            before = placed[-1][0] + placed[-1][1]
            axes.annotate("", (x, 0.0), (before, 0.0), arrowprops=_ARROW)
        placed.append((x, width))
        x += width + gap * (0.6 if volume.made_by == "max-pooling" else 0.5)
    if network.skips:
        pooled = [k for k, volume in enumerate(volumes) if volume.made_by == "max-pooling"]
        raised = [k for k, volume in enumerate(volumes) if volume.made_by == "upsampling"]
        for level, (left, right) in enumerate(zip(pooled, reversed(raised), strict=True)):
            # What is kept is what the pooling reads.
            source = volumes[left - 1]
            ends = [placed[k][0] + placed[k][1] / 2 for k in (left - 1, right)]
            top, foot = 0.85 - 0.07 * level, 0.06 + source.voxels / tallest / 2 + 0.13
            axes.plot([ends[0], ends[0], ends[1], ends[1]], [foot, top, top, foot], **_KEPT)
            axes.plot(ends[1], foot, "v", markersize=3.0, color="#666666")
    axes.set(xlim=(-0.1, x), ylim=(-0.72, 0.9 if network.skips else 0.75))
    axes.axis("off")
