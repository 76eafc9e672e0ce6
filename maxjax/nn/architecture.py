"""Architectures of the autoencoders that predict the potential: static data, and one table of names.

`PAPER` is the network of Bong and Beltrame (arXiv 2605.10880, section III-B): five levels of one 3³ convolution,
no skip connections, 101 → 50 → 25 → 12 → 6 → 3 voxels and back, 4,121,409 weights; the receptive field of its
bottleneck is 94 voxels.
`PAPER_2D` is the planar original with kernels from 11² to 3², and `PAPER_LARGE` the same kernels in three dimensions.
The paper does not list them; of the sequences that fall from 11 to 3, 11-11-7-5-3 in the encoder with its 3³ decoder
comes to 6.26 million weights, the paper states 6.25.

`MAXJAX` has skip connections, and works on patches of 2³ voxels: they enter as channels of a grid of
51³ and leave as its channels. The finest grid, where most of the work of the paper's network is, then holds no
features.
"""

from __future__ import annotations

import dataclasses

import jax

from maxjax.nn.encoding import FLOOD_CHANNELS, Start


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Autoencoder:
    """Architecture; static.

    Attributes:
        encoder: for each level, finest first, output channels of each of its convolutions.
        decoder: the same, coarsest first; as many levels.
        kernels: taps along an axis of the encoder's convolutions, level by level; all others have 3.
        dimensions: of the grid.
        start: what the output is added to (`nn.encoding`).
        flood: whether the distance by a flood from the goal is among the inputs.
        skips: whether encoder features are kept for the decoder.
        patch: edge of the patches that enter and leave as channels [voxels], 1 or 2.
        dropout: share of the bottleneck's features that training drops.

    Raises:
        ValueError: for levels that do not match, or values out of range.
    """

    encoder: tuple[tuple[int, ...], ...]
    decoder: tuple[tuple[int, ...], ...]
    kernels: tuple[int, ...]
    dimensions: int = 3
    start: Start = "nothing"
    flood: bool = False
    skips: bool = False
    patch: int = 1
    dropout: float = 0.1

    def __post_init__(self) -> None:
        if not len(self.encoder) == len(self.decoder) == len(self.kernels) or not all((*self.encoder, *self.decoder)):
            raise ValueError(
                "Autoencoder: expected encoder, decoder and kernels of as many levels, with a convolution in each, "
                f"given {self.encoder}, {self.decoder} and {self.kernels}"
            )
        if self.patch not in (1, 2) or not 0 <= self.dropout < 1 or min(self.kernels) % 2 == 0:
            raise ValueError(
                "Autoencoder: expected patches of 1 or 2, odd kernels and a dropout below 1, given "
                f"{self.patch}, {self.kernels} and {self.dropout}"
            )

    @property
    def inputs(self) -> int:
        """Channels given for each voxel."""
        return 1 + FLOOD_CHANNELS * self.flood

    @property
    def channels(self) -> int:
        """Channels that a patch has for each number of its voxels."""
        return int(self.patch**self.dimensions)

    def spaces(self, space: tuple[int, ...]) -> list[tuple[int, ...]]:
        """The grid of each level, finest first, and of the bottleneck.

        Raises:
            ValueError: for a grid that is too small for the number of poolings, or of another dimension.
        """
        found = [tuple(-(-n // self.patch) for n in space)]
        for _ in self.encoder:
            found.append(tuple(n // 2 for n in found[-1]))
        if len(space) != self.dimensions or min(found[-1]) < 1:
            least = self.patch * 2 ** len(self.encoder)
            raise ValueError(
                f"grid: expected {self.dimensions} dimensions of at least {least} voxels for {len(self.encoder)} "
                f"poolings, given {space}"
            )
        return found


_PAPER = ((16,), (32,), (64,), (128,), (256,))
_BACK = ((256,), (128,), (64,), (32,), (16,))
_LARGE = (11, 11, 7, 5, 3)

PAPER = Autoencoder(_PAPER, _BACK, (3,) * 5)
PAPER_DIFFERENCE = dataclasses.replace(PAPER, start="free")
PAPER_2D = Autoencoder(_PAPER, _BACK, _LARGE, dimensions=2)
PAPER_LARGE = Autoencoder(_PAPER, _BACK, _LARGE)
MAXJAX = Autoencoder(
    encoder=((32,), (48, 48), (96, 96), (128, 128)),
    decoder=((128, 128), (96, 96), (48, 48), (32,)),
    kernels=(3,) * 4,
    start="free",
    flood=True,
    skips=True,
    patch=2,
    dropout=0.0,
)
MAXJAX_NO_FLOOD = dataclasses.replace(MAXJAX, flood=False)

# Trains in seconds, for trying things out.
TINY = dataclasses.replace(MAXJAX, encoder=((4,), (8,)), decoder=((8,), (4,)), kernels=(3, 3))

CONFIGS: dict[str, Autoencoder] = {
    "paper": PAPER,
    "paper_difference": PAPER_DIFFERENCE,
    "paper2d": PAPER_2D,
    "paper_large": PAPER_LARGE,
    "maxjax": MAXJAX,
    "maxjax_no_flood": MAXJAX_NO_FLOOD,
    "tiny": TINY,
}
