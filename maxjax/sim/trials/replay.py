"""One trial by itself, one planning period after the other, for inspection of everything that evolves."""

from __future__ import annotations

import jax

from maxjax.sim.loop.flight import Flight, watch
from maxjax.sim.trials.batches import beside_movers, draw_trials, world_of
from maxjax.sim.trials.campaign import Campaign, outcome_of
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome, on_host


def replay(campaign: Campaign, ledger: Ledger) -> tuple[Outcome, list[Flight]]:
    """Fly the first trial of a campaign step by step.

    Args:
        campaign: of one trial.
        ledger: that keeps its positions, and its outcome unless it holds one.

    Returns:
        Its outcome, and the flight after each planning iteration; none if it cannot be flown.
    """
    with ledger.held():
        drawn = draw_trials(campaign)
        flights: list[Flight] = []
        if drawn["valid"][0]:
            world = world_of(campaign, drawn, 0)
            flights = list(watch(world, campaign.flight))
            logs = {name: values[None] for name, values in on_host(flights[-1].log).items()}
            if world.movers is not None:
                logs |= beside_movers(logs, *jax.tree.map(lambda x: x[None], (world.geoms, world.movers)))
            outcome = outcome_of(campaign, drawn, 0, logs)
            ledger.record_positions([outcome.trial], logs["position"])
        else:
            outcome = outcome_of(campaign, drawn, 0)
        if outcome.trial not in ledger.outcomes:
            ledger.append([outcome])
        return outcome, flights
