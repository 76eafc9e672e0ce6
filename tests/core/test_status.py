"""Nothing but OK passes for success."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from maxjax import Status


def test_only_ok_is_zero_and_none_is_truthy() -> None:
    assert [status for status in Status if status == 0] == [Status.OK]
    assert not any(bool(status) for status in Status)
    assert len({int(status) for status in Status}) == len(Status)


def test_every_status_says_what_to_do() -> None:
    advice = [status.advice for status in Status]
    assert all(sentence.endswith(".") and len(sentence) > 20 for sentence in advice)
    assert len(set(advice)) == len(Status)


def test_travels_through_jit_as_int32() -> None:
    @jax.jit
    def judge(bad: jax.Array) -> jax.Array:
        return jnp.where(bad, Status.NO_VALID_PATH, Status.OK).astype(jnp.int32)

    assert judge(jnp.array(True)).dtype == np.int32
    assert Status(int(judge(jnp.array(True)))) is Status.NO_VALID_PATH
    assert Status(int(judge(jnp.array(False)))) is Status.OK
