"""The agreement by which vehicles swap their motions one after the other, though all they know of each other is late.

Every vehicle is committed to a motion that ends at rest. To swap it at look n + w it proposes the new one at look n.
After each look it sends to all what it is committed to and what it proposes; messages may be late, by different times,
or get lost. At look n + w it swaps if

    informed:  of every other vehicle it has a message sent at look n or later
    clear:     its proposal is `apart` from what each of these says that the other is committed to,
               and from what the other proposes, if that goes first

and else drops the proposal. Proposals go by the look at which they were made, then by a number that differs among
vehicles and is another one at each look (`rank`).

Theorem. If the motions of all vehicles are apart at the beginning, those that they are committed to are apart at all
times: whatever the delays, and whatever is lost.
Proof. By induction over looks. Let i swap at look m to what it proposed at n = m − w, and let j, proposed at k, be what
another vehicle is committed to after look m. All wait w looks, so k ≤ n.
  k < n, or k = n and j goes first: by look n the other had proposed j, and until look m it neither drops nor replaces
      it. The message of look n or later that i has names j, as a proposal that goes first or as what the other is
      committed to: i is apart from it.
  k = n and i goes first: the other swaps at look m as well, having a message that i sent at look n or later, before
      look m. That names i as a proposal that goes first: j is apart from it. ∎

What the theorem needs: looks are numbered by a common clock, a message says what was sent, every vehicle keeps w, and
flies what it is committed to. A delay beyond w costs swaps, not separation.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int32

from maxjax.sim.swarm.separation import Sampled, Scheduled, courses, separation

# Look of a proposal where there is none, and of what is committed to at the beginning.
NEVER = -(2**30)


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Agreement:
    """The agreement of all vehicles; static.

    Attributes:
        wait: w, looks from a proposal to its swap.
        apart: distance that motions keep [m]: of two vehicles, and how far each may be from its motion.
        sampled: at which times motions are compared.

    Raises:
        ValueError: for a wait of no look, or a distance that is not positive.
    """

    wait: int
    apart: float
    sampled: Sampled

    def __post_init__(self) -> None:
        if self.wait < 1:
            raise ValueError(f"Agreement.wait: expected at least 1 look, given {self.wait}")
        if not self.apart > 0.0:
            raise ValueError(f"Agreement.apart: expected a positive number, given {self.apart}")


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Message:
    """The message of a vehicle after a look; batch axes lead.

    Attributes:
        committed: the motion that it flies, to its end.
        proposal: the motion that it means to swap to when that starts.
        proposed: look at which it was proposed; `NEVER`: there is no proposal.
        sent: look after which this was so.
    """

    committed: Scheduled
    proposal: Scheduled
    proposed: Int32[Array, "*batch"]
    sent: Int32[Array, "*batch"]


def at_rest(motion: Scheduled, look: Int32[Array, ""]) -> Message:
    """The message of a vehicle that is committed to a motion, and proposes nothing."""
    return Message(motion, motion, jnp.int32(NEVER), look)


def swap_proposal(
    own: Message, told: Message, index: Int32[Array, ""], look: Int32[Array, ""], agreement: Agreement
) -> tuple[Message, Bool[Array, ""]]:
    """The own message without the proposal whose look has come, and whether that was swapped to.

    Args:
        own: of the last look.
        told: the latest that is known of every vehicle, along a leading axis; that of the own one is not looked at.
        index: of the own vehicle in `told`.
        look: now.
        agreement: static.
    """
    sampled = agreement.sampled
    others = jnp.arange(len(told.sent)) != index
    mine = courses(own.proposal, look, sampled)

    def clear(theirs: Scheduled) -> Bool[Array, " n"]:
        return separation(mine, courses(theirs, look, sampled), sampled) >= agreement.apart

    numbers = jnp.arange(len(told.sent))
    earlier = told.proposed < own.proposed
    same = (told.proposed == own.proposed) & (rank(numbers, own.proposed) < rank(index, own.proposed))
    goes_first = (told.proposed != NEVER) & (earlier | same)
    agreed = (told.sent >= own.proposed) & clear(told.committed) & (clear(told.proposal) | ~goes_first)
    due = (own.proposed != NEVER) & (look == own.proposal.start)
    swaps = due & jnp.all(agreed | ~others)
    committed = jax.tree.map(lambda new, old: jnp.where(swaps, new, old), own.proposal, own.committed)
    proposed = jnp.where(due, NEVER, own.proposed)
    return Message(committed, own.proposal, proposed, look), swaps


def proposing(own: Message, motion: Scheduled, wants: Bool[Array, ""], look: Int32[Array, ""]) -> Message:
    """The own message with a proposal made now, if one is wanted and none is under way.

    Args:
        own: of this look.
        motion: which starts `Agreement.wait` looks from now, where the own one leads by then.
        wants: whether to propose it.
        look: now.
    """
    new = wants & (own.proposed == NEVER)
    proposal = jax.tree.map(lambda x, y: jnp.where(new, x, y), motion, own.proposal)
    return Message(own.committed, proposal, jnp.where(new, look, own.proposed), own.sent)


def rank(index: Int32[Array, "*n"], look: Int32[Array, ""]) -> Array:
    """Order of the vehicles at a look: an invertible function of the index, so that no two are equal."""
    x = index.astype(jnp.uint32) * jnp.uint32(0x9E3779B1) ^ (look.astype(jnp.uint32) * jnp.uint32(0x85EBCA6B))
    x = (x ^ (x >> 16)) * jnp.uint32(0x7FEB352D)
    x = (x ^ (x >> 15)) * jnp.uint32(0x846CA68B)
    mixed: Array = x ^ (x >> 16)
    return mixed
