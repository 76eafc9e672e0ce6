"""State of a vehicle of a swarm besides its flight: its messages under way, and how near the others were."""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

from maxjax.sim.movers.motions import MotionPrimitive, at
from maxjax.sim.swarm.agreement import Message, at_rest
from maxjax.sim.swarm.separation import Scheduled

# Number of the other vehicle where there was no contact.
NOBODY = -1


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Member:
    """A vehicle of a swarm; batch axes lead.

    Attributes:
        sent: messages after the last w looks, the latest first.
        since: time since the last look [s].
        gap: least distance from its body to another one so far [m].
        touched: number of the first vehicle that it was in contact with; `NOBODY`: none.
        swaps: proposals that it swapped to.
        dropped: proposals that it dropped.
    """

    sent: Message
    since: Float[Array, "*batch"]
    gap: Float[Array, "*batch"]
    touched: Int32[Array, "*batch"]
    swaps: Int32[Array, "*batch"]
    dropped: Int32[Array, "*batch"]

    @property
    def latest(self) -> Message:
        """The latest message."""
        found: Message = jax.tree.map(lambda x: x[0], self.sent)
        return found

    @property
    def oldest(self) -> Message:
        """The message that arrives now."""
        found: Message = jax.tree.map(lambda x: x[-1], self.sent)
        return found


def hovering(motion: MotionPrimitive, wait: int) -> Member:
    """A member that has been at rest for longer than messages are under way."""
    said = at_rest(Scheduled(motion, jnp.int32(0)), jnp.int32(0))
    sent = jax.tree.map(lambda x: jnp.broadcast_to(x, (wait, *x.shape)), said)
    none = jnp.int32(0)
    return Member(sent, jnp.float32(0.0), jnp.float32(math.inf), jnp.int32(NOBODY), none, none)


def saying(member: Member, message: Message) -> Member:
    """The member after a look, with a message in place of the oldest one."""
    sent = jax.tree.map(lambda x, new: jnp.concatenate([new[None], x[:-1]]), member.sent, message)
    return dataclasses.replace(member, sent=sent, since=jnp.zeros_like(member.since))


def place_of_commitment(member: Member, period: float) -> Float[Array, "3"]:
    """Where the motion that it is committed to leads by now [m]; `period` of looks [s]."""
    latest = member.latest
    looks = (latest.sent - latest.committed.start).astype(jnp.float32)
    return at(latest.committed.motion, period * looks + member.since)[0]
