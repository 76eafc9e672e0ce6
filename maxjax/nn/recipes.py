"""Recipes of training: what is trained, for how long, and by which loss."""

from __future__ import annotations

import dataclasses
from typing import Literal

import jax

from maxjax.nn.architecture import CONFIGS, Autoencoder
from maxjax.nn.layers import Formulation

Precision = Literal["float32", "bfloat16"]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Training:
    """A recipe; static. Its defaults are the paper's, where the paper states them.

    Attributes:
        model: name in `architecture.CONFIGS`.
        epochs: passes over the scenes.
        batch: scenes a step.
        rate: peak learning rate.
        warmup: steps in which the rate rises.
        decay: of AdamW.
        slope: s of the loss [voxels²].
        turned: whether each scene is taken in one of its eight symmetries about the vertical, drawn anew each time.
        precision: of convolutions; weights, sums and the loss stay float32.
        by: how convolutions are computed (`layers.convolve`).
        seed: of weights, order, symmetries and dropout.
    """

    model: str = "paper"
    epochs: int = 200
    batch: int = 8
    rate: float = 1e-3
    warmup: int = 0
    decay: float = 1e-2
    slope: float = 0.0
    turned: bool = False
    precision: Precision = "bfloat16"
    by: Formulation = "direct"
    seed: int = 0

    @property
    def network(self) -> Autoencoder:
        """The architecture.

        Raises:
            ValueError: for an unknown model, with the list of models.
        """
        if self.model not in CONFIGS:
            raise ValueError(f"model: expected one of {', '.join(CONFIGS)}, given {self.model!r}")
        return CONFIGS[self.model]


RECIPES: dict[str, Training] = {
    "paper": Training("paper"),
    "paper_difference": Training("paper_difference"),
    # XLA's own convolution takes nearly twice as long with kernels of 11³ (`benchmarks.training`).
    "paper_large": Training("paper_large", by="planes"),
    "maxjax": Training("maxjax", warmup=200, slope=1.0, turned=True),
    "tiny": Training("tiny", epochs=8, batch=4, slope=1.0, turned=True),
    "maxjax_no_flood": Training("maxjax_no_flood", warmup=200, slope=1.0, turned=True),
}
