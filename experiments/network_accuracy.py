"""How far the networks' fields are from the certified one, on maps that they never saw.

    python -m experiments.network_accuracy                # 100 scenes a map and price; two CPU cores: an hour

Scenes as in training (`maxjax.sim.mapping.scanned_city`: one scan of 32,768 rays from a place in the open, its voxels
as a hard set, a goal), but of `downtown` and `suburb`: the networks were trained on `midtown` alone. The truth is the
solver's certified potential, with the planner's prices and without; networks that read no prices are judged without.
Errors are those of `maxjax.nn.evaluation`, scene by scene; the rows hold means over the scenes. `analytic` is the
closed law of free space, which the default network adds to: what it says without any network.

Expected: relative L2 below 0.02 on both maps for the default network with the planner's prices and below 0.01 without,
where the paper has 0.153 and 0.051.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Array, Float

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, table
from maxjax.core.grid import Grid
from maxjax.fields.price import Price
from maxjax.nn.autoencoder import init_params
from maxjax.nn.dataset import Chunks, Scenes, generate, network_inputs, usable
from maxjax.nn.encoding import encode
from maxjax.nn.evaluation import errors, evaluate
from maxjax.nn.layers import count
from maxjax.nn.model import load_model, shipped_networks
from maxjax.sim.mapping.scanned_city import TINY_GRID, ScannedCity

RESULTS = Path(__file__).parent / "results"
# The paper, section IV: relative L2 in its dense and its open city.
_PAPER = {"downtown": 0.153, "suburb": 0.051}


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scenes: a map.
        maps: unseen in training.
        models: networks; None: all whose weights come with maxjax.
        trained: folders that `maxjax train` left, of networks besides.
        grid: shape and spacing; it is moved to each scene's sensor.
        chunk: scenes made at a time.
        seed: of the scenes.
        out: where the JSON goes.
    """

    scenes: int = 100
    maps: tuple[str, ...] = ("downtown", "suburb")
    models: tuple[str, ...] | None = None
    trained: tuple[Path, ...] = ()
    grid: Grid = Grid()  # noqa: RUF009 (frozen)
    chunk: int = 4
    seed: int = 0
    out: Path = RESULTS


TINY = Config(scenes=4, maps=("midtown",), grid=TINY_GRID)


def main(config: Config) -> list[Row]:
    """Label scenes, judge every network on them; save one row a map and network."""
    models = [load_model(name) for name in (shipped_networks() if config.models is None else config.models)]
    models += [load_model(folder.name, folder / f"{folder.name}.npz") for folder in config.trained]
    grid = config.grid
    rows: list[Row] = []
    for (number, name), height in itertools.product(enumerate(config.maps), (Price().height, 0.0)):
        key = jax.random.fold_in(jax.random.key(config.seed), 1000 + number)
        # Some more than wanted: in a few places no goal can be reached.
        drawn = -(-(config.scenes + config.scenes // 16) // config.chunk) * config.chunk
        city = ScannedCity(name, grid, (height, height))
        found = usable(generate(city, key, drawn, grid, Chunks(config.chunk)))
        scenes = jax.tree.map(lambda leaf: leaf[: config.scenes], found)
        judged = {"analytic": (0, _analytic(scenes, grid))}
        for model in models:
            if height and not model.network.flood:
                continue  # it reads no prices
            weights = count(jax.eval_shape(lambda key, of=model.network: init_params(key, of), jax.random.key(0)))
            judged[model.name] = (weights, evaluate(model.params, scenes, model.network, grid, model.by))
        for method, (weights, each) in judged.items():
            figures = {field: np.asarray(values) for field, values in each.items()}
            rows.append(
                {
                    "map": name,
                    "height": height,
                    "network": method,
                    "weights": weights or None,
                    "scenes": len(scenes.status),
                    "l2": round(float(figures["l2"].mean()), 5),
                    "l2_worst": round(float(figures["l2"].max()), 5),
                    "l2_normalised": round(float(figures["l2_normalised"].mean()), 5),
                    "angle_median_deg": round(float(figures["angle_median"].mean()), 3),
                    "angle_95_deg": round(float(figures["angle_95"].mean()), 3),
                }
            )
    save("network_accuracy", config, rows, config.out)
    return rows


@functools.partial(jax.jit, static_argnames="grid")
def _analytic(scenes: Scenes, grid: Grid) -> dict[str, Float[Array, " n"]]:
    """Errors of the closed law of free space."""

    def one(scene: Scenes) -> dict[str, Float[Array, ""]]:
        return errors(encode("free", False, network_inputs(scene, grid))[1], scene)

    found: dict[str, Float[Array, " n"]] = jax.lax.map(one, scenes)
    return found


def section(document: Document) -> str:
    """RESULTS.md: errors of every network on every map, and the paper's."""
    lines = [
        [
            str(row["map"]),
            f"{row['height']:g}" if row.get("height") else "none",
            str(row["network"]),
            "–" if row["weights"] is None else f"{row['weights']:,}",
            f"{row['l2']:.4f} ({row['l2_worst']:.4f})",
            f"{row['l2_normalised']:.4f}",
            f"{row['angle_median_deg']:.1f}",
            f"{row['angle_95_deg']:.1f}",
        ]
        for row in document["rows"]
    ]
    lines += [
        [name, "none", "3DMaxConvNet, the paper", "4,121,409", "", f"{l2:.3f}", "", ""] for name, l2 in _PAPER.items()
    ]
    heads = ["map", "price", "network", "weights", "L2 (worst)", "L2, normalised", "angle [°]", "angle, 95 % [°]"]
    return (
        f"### Accuracy of the networks' fields ({device(document)})\n\n"
        f"Means over {document['config']['scenes']} scenes a map, against the certified potential. L2 is of the\n"
        "log-potential −ℓ log φ, a distance in voxels; normalised, of the same scaled to 1 at the goal and 0 at the\n"
        "farthest voxel, which is the paper's quantity as we read it. Its cities are others than ours. Angles are\n"
        "between gradients: the median and the 95th percentile over a scene's voxels. Price: its height, as a planner\n"
        "asks for it, or none.\n\n" + table(heads, lines, left=3)
    )


if __name__ == "__main__":
    main(configured(TINY))
