"""A campaign in shares that processes fly apart, and its folder made of theirs.

    share of process k of n = trials [k T / n, (k + 1) T / n), rounded down         T trials, k from 0 to n - 1

A share is a campaign by itself, in a folder of its own below that of the whole: no two processes write to one file,
which a network file system would not survive. What is made of all of them equals what one process would have left: the
outcome of a trial depends on the campaign and its index alone.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.ledger import CONFIG, Ledger
from maxjax.sim.trials.outcomes import Outcome

SHARDS = "shards"
_RANGE = ("first", "trials")  # all that differs in the configuration of a share


@dataclasses.dataclass(frozen=True)
class Shard:
    """Process `index` of `count`, from 0 on.

    Raises:
        ValueError: if there is no such process.
    """

    index: int
    count: int

    def __post_init__(self) -> None:
        if not 0 <= self.index < self.count:
            raise ValueError(f"shard: expected K/N with K from 0 to N - 1, given {self.index}/{self.count}")

    @classmethod
    def of(cls, text: str) -> Shard:
        """The shard of a text, as 3/8; raises as the class."""
        found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
        if found is None:
            raise ValueError(f"shard: expected K/N with K from 0 to N - 1, given {text!r}")
        return cls(int(found[1]), int(found[2]))

    def share(self, trials: range) -> range:
        """Its trials: a run of them, since the trials of a city are drawn together; none where there are too few."""
        return trials[self.index * len(trials) // self.count : (self.index + 1) * len(trials) // self.count]

    def folder(self, out: Path) -> Path:
        """The folder of its share, below that of the campaign."""
        return out / SHARDS / f"{self.index}-of-{self.count}"


@dataclasses.dataclass(frozen=True)
class Merged:
    """The shares of a campaign in their folders.

    Attributes:
        shards: how many folders there are.
        missing: trials without an outcome, in order; if there are any, nothing was written.
        doubled: how many trials have an outcome, the same one, in more than one folder.
    """

    shards: int
    missing: tuple[int, ...]
    doubled: int


def merge(campaign: Campaign, out: Path) -> Merged:
    """Make the folder of a campaign from those of its shares, unless a trial is missing.

    Lines, positions and configuration become those of a campaign that one process flew, the lines in its order: first
    trials that could not be drawn, then the others. What the folder holds already is one share more. The others stay
    as they are.

    Args:
        campaign: the whole.
        out: its folder; those of the shares are in `shards` below, under any name.

    Raises:
        ValueError: if there are none, if one holds another campaign or damaged files, if they were flown by different
            sources or versions, or if two differ about a trial.
        OSError: if `out` cannot be written.
    """
    shards = [Ledger.read(config.parent) for config in sorted((out / SHARDS).glob(f"*/{CONFIG}"))]
    if not shards:
        raise ValueError(f"{out / SHARDS}: expected folders of shares, as fly --shard K/N writes them, found none")
    begun = [Ledger.read(out)] if (out / CONFIG).exists() else []
    for folder in [*begun, *shards]:
        _check(campaign, folder)
    _same_code([*begun, *shards])
    outcomes, _ = _together([*begun, *shards])
    _, doubled = _together(shards)
    missing = tuple(trial for trial in campaign.trials if trial not in outcomes)
    if not missing:
        _write(campaign.ledger(out), shards, list(outcomes.values()))
    return Merged(len(shards), missing, doubled)


def _check(campaign: Campaign, shard: Ledger) -> None:
    """Refuse a share of another campaign."""
    whole, own = campaign.configuration(), shard.configuration
    differing = [name for name in {**own, **whole} if name not in _RANGE and own.get(name) != whole.get(name)]
    if differing:
        name = differing[0]
        raise ValueError(
            f"{shard.folder}: a share of another campaign: {name} is {own.get(name)} there, {whole.get(name)} here; "
            "give the options that it was flown with, or remove it"
        )
    if foreign := sorted(set(shard.outcomes) - set(campaign.trials)):
        raise ValueError(
            f"{shard.folder}: holds trial {foreign[0]}, which is not of this campaign; give the --trials that it was "
            "flown with"
        )


def _same_code(shards: Sequence[Ledger]) -> None:
    """Refuse shares that were flown by different sources or versions; devices may differ."""
    codes = [
        (shard.folder, {**maker, "device": None})
        for shard in shards
        for maker in shard.flown_by or [{}] * bool(shard.outcomes)
    ]
    for folder, code in codes[1:]:
        if code != codes[0][1]:
            raise ValueError(
                f"{folder}: flown by other sources or versions than {codes[0][0]}; remove one of them, and fly its "
                "share again"
            )


def _together(shards: Sequence[Ledger]) -> tuple[dict[int, Outcome], int]:
    """The outcomes of all shares by trial, and how many are in more than one."""
    outcomes: dict[int, Outcome] = {}
    places: dict[int, Path] = {}
    doubled = set()
    for shard in shards:
        for trial, outcome in shard.outcomes.items():
            if outcomes.setdefault(trial, outcome) != outcome:
                raise ValueError(
                    f"{shard.folder}: its trial {trial} ended otherwise than in {places[trial]}; remove one"
                )
            if places.setdefault(trial, shard.folder) != shard.folder:
                doubled.add(trial)
    return outcomes, len(doubled)


def _write(whole: Ledger, shards: Sequence[Ledger], outcomes: Sequence[Outcome]) -> None:
    with whole.held():
        positioned = {trial for trials, _ in whole.batches() for trial in trials}
        for shard in shards:
            for trials, positions in shard.batches():
                new = [row for row, trial in enumerate(trials) if trial not in positioned]
                if new:
                    whole.record_positions([trials[row] for row in new], positions[new])
                positioned.update(trials)
        whole.record_batch_size(shards[0].batch)
        whole.record_makers(maker for shard in shards for maker in shard.flown_by)
        if not whole.times():
            whole.record_times([time for shard in shards for time in shard.times()])
        # Last, since with all its lines a folder counts as flown.
        whole.rewrite(sorted(outcomes, key=lambda outcome: (outcome.flown, outcome.trial)))
