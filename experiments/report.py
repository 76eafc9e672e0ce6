"""RESULTS.md, written from the result files and from nothing else.

    python -m experiments.report          (or: make results)

Every experiment turns its own JSON into its section; this page orders them, and says where each figure comes from. A
test compares page and files, so that no figure there can differ from the run that it names.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from benchmarks import tables
from benchmarks.common.markdown import Document, sources

HERE = Path(__file__).parent
BENCHMARKS = HERE.parent / "benchmarks" / "results"
PAGE = HERE / "RESULTS.md"

# Chapter: result file and module of each section, in order.
CHAPTERS: dict[str, tuple[tuple[str, str], ...]] = {
    "The paper's table": (
        ("offline_table", "offline_table"),
        ("offline_table_own", "offline_table"),
        ("closed_loop", "closed_loop"),
        ("closed_loop_many", "closed_loop"),
        ("closed_loop_disturbed", "closed_loop"),
        ("closed_loop_disturbed_suburb", "closed_loop"),
        ("faults", "faults"),
        ("faults_random", "faults"),
        ("paper_readings", "paper_loop.tables"),
        ("paper_loop", "paper_loop.tables"),
    ),
    "The networks": (
        ("network_training", "network_training"),
        ("network_accuracy", "network_accuracy"),
        ("network_cost", "network_cost"),
        ("network_cost_h200", "network_cost"),
        ("network_plans", "network_cost"),
        ("offline_networks", "offline_many"),
        ("completion_training", "completion.tables"),
        ("completion", "completion.tables"),
    ),
    "Problems and maps that judge": (
        ("random_problems", "random_problems"),
        ("hard_maps", "hard_maps.study"),
        ("warframe_crops", "warframe_crops"),
        ("warframe_full", "warframe_full"),
        ("real_cities", "real_cities"),
        ("long_ways", "long_ways"),
        ("clearance", "clearance"),
        ("clearance_ablation", "clearance"),
        ("trajectories", "trajectories"),
        ("trajectories_many", "trajectories"),
        ("follower", "follower"),
        ("covering", "covering"),
        ("inspecting", "inspecting"),
        ("onboard_loop", "onboard_loop"),
    ),
    "A world that moves": (
        ("tracking", "tracking"),
        ("moving_cities", "moving_cities"),
        ("moving_encounters", "moving_cities"),
        ("moving_suburb", "moving_cities"),
        ("moving_protocols", "moving_protocols"),
        ("moving_p2m", "moving_protocols"),
        ("moving_p2m_true", "moving_protocols"),
        ("fleets", "fleets"),
        ("fleets_many", "fleets"),
    ),
    "What can be differentiated": (
        ("differentiable_inverse", "differentiable.inverse"),
        ("differentiable_design", "differentiable.design"),
        ("differentiable_learning", "differentiable.learning"),
        ("differentiable_sensitivity", "differentiable.sensitivity"),
    ),
    "Ablations": (("ablations", "ablations.tables"), ("ablations_closed_loop", "ablations.tables")),
}

# Table and the result files that it takes, of the chapter on speed.
SPEED: tuple[tuple[Callable[..., str], tuple[str, ...]], ...] = (
    (tables.rivals, ("rivals", "rivals_h100")),
    (tables.plans, ("plan", "plan_h100")),
    (tables.solves, ("potential", "potential_h200")),
    (tables.verdicts, ("verifier", "verifier_h100")),
    (tables.profile, ("profile", "profile_h200", "profile_city_h200")),
    (tables.flights, ("flight", "flight_h200", "flight_campaign_h200")),
    (tables.scaling, ("training_h200", "city_scale_h200")),
    (tables.cities, ("city_plan",)),
    (tables.lidar, ("lidar", "lidar_h200")),
    (tables.inspection, ("inspection",)),
    (tables.onboard_movers, ("onboard_movers",)),
    (tables.ros_node, ("ros_node",)),
    (tables.link_loss, ("link_loss",)),
    (tables.first_hour, ("first_hour",)),
    (tables.startup, ("startup",)),
    (tables.page, ("page",)),
    (tables.service, ("service",)),
    (tables.history, ("history",)),
)

# Likewise, of what other people's files and messages do.
INPUTS: tuple[tuple[Callable[..., str], tuple[str, ...]], ...] = (
    (tables.fuzz, ("fuzz",)),
    (tables.mutations, ("mutations",)),
)

_HEAD = """# Results

Written by `make results` from the files in [results/](results); a test compares them. The last table says which command
made which file, on what device and at which commit. The paper is Bong and Beltrame,
[arXiv:2605.10880](https://arxiv.org/abs/2605.10880).
"""


def page(folder: Path = HERE / "results", benchmarks: Path = BENCHMARKS) -> str:
    """The text of RESULTS.md; sections whose file is not there yet are left out."""
    parts = [_HEAD]
    found: dict[str, Document] = {}

    def load(path: Path, link: str) -> Document:
        document: Document = json.loads(path.read_text(encoding="utf-8"))
        found[f"{link}/{path.name}"] = document
        return document

    for chapter, sections in CHAPTERS.items():
        texts = []
        for name, module in sections:
            if (folder / f"{name}.json").is_file():
                section: Callable[[Document], str] = import_module(f"experiments.{module}").section
                texts.append(section(load(folder / f"{name}.json", "results")))
        parts += _chapter(chapter, texts)
    for chapter, written in (("Faulty inputs", INPUTS), ("Speed", SPEED)):
        texts = []
        for write, names in written:
            files = [benchmarks / f"{name}.json" for name in names if (benchmarks / f"{name}.json").is_file()]
            if files:
                texts.append(write(*[load(file, "../benchmarks/results") for file in files]))
        parts += _chapter(chapter, texts)
    return "\n".join([*parts, "## Where these figures come from\n", sources(found)])


def _chapter(title: str, texts: list[str]) -> list[str]:
    """A chapter of sections; a section's heading stands below its chapter's, and others below it."""
    levelled = [re.sub(r"^#+ ", "#### ", text.strip(), flags=re.MULTILINE).removeprefix("#") + "\n" for text in texts]
    return [f"## {title}\n", *levelled] if levelled else []


def main() -> None:
    """Rewrite RESULTS.md."""
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
