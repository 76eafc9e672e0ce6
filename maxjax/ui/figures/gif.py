"""Frames as an animated GIF with one palette between them, and no larger than wanted."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

RATE = 10  # frames a second
LARGEST = 6_000_000  # [B]
_COLORS = 128


def animation(frames: list[Any], colors: Sequence[str]) -> bytes:
    """Images of Pillow as a GIF of `RATE` frames a second and at most `LARGEST` bytes, if need be of fewer frames.

    Args:
        frames: in order; the last one stays for two seconds, and is always kept.
        colors: those that mean something ("#RRGGBB"), which are shown exactly however little they cover.
    """
    while len(content := _gif(frames, colors)) > LARGEST and len(frames) > 2:
        frames = [*frames[:-1:2], frames[-1]]
    return content


def _gif(frames: list[Any], colors: Sequence[str]) -> bytes:
    """Frames with one palette between them, without dithering, which would make each new to the last pixel."""
    from PIL import Image

    meant = [[int(color[at : at + 2], 16) for at in (1, 3, 5)] for color in (*colors, "#FFFFFF")]
    common = frames[len(frames) // 2].quantize(_COLORS - len(meant)).getpalette()
    palette = np.concatenate([meant, np.reshape(common, (-1, 3))[: _COLORS - len(meant)]])
    # The nearest of them for each colour of five bits a channel; what means something has its own.
    bits = np.stack(np.unravel_index(np.arange(2**15), (32, 32, 32)), -1)
    nearest = np.argmin(((8 * bits + 4)[:, None] - palette) ** 2 @ np.ones(3), axis=1).astype(np.uint8)
    nearest[np.ravel_multi_index(tuple(np.asarray(meant).T // 8), (32, 32, 32))] = np.arange(len(meant))
    plain = []
    for frame in frames:
        index = np.asarray(frame).astype(np.int32) // 8 @ np.array([1024, 32, 1])
        plain.append(Image.fromarray(nearest[index]))
        plain[-1].putpalette(palette.astype(np.uint8).tobytes())
    buffer = io.BytesIO()
    lasts = [1000 // RATE] * (len(plain) - 1) + [2000]
    plain[0].save(buffer, "GIF", save_all=True, append_images=plain[1:], duration=lasts, loop=0, optimize=False)
    return buffer.getvalue()
