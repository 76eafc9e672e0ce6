"""AdamW and its schedule against NumPy in float64."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np

from maxjax.nn import optimizer
from maxjax.nn.optimizer import AdamW


def reference(w: np.ndarray, gradients: list[np.ndarray], settings: AdamW) -> np.ndarray:
    """Algorithm 2 of Loshchilov and Hutter (2019), written out."""
    m, v = np.zeros_like(w), np.zeros_like(w)
    for t, g in enumerate(gradients, start=1):
        m = settings.beta1 * m + (1 - settings.beta1) * g
        v = settings.beta2 * v + (1 - settings.beta2) * g**2
        rise = min(t / (settings.warmup + 1), 1)
        done = max(t - 1 - settings.warmup, 0) / (settings.steps - settings.warmup)
        rate = settings.rate * rise * 0.5 * (1 + math.cos(math.pi * done))
        step = m / (1 - settings.beta1**t) / (np.sqrt(v / (1 - settings.beta2**t)) + settings.epsilon)
        w = w - rate * step - rate * settings.decay * w
    return w


def test_updates_equal_the_reference() -> None:
    rng = np.random.default_rng(0)
    settings = AdamW(rate=0.03, steps=20, warmup=4, decay=0.1)
    start = {"a": rng.normal(size=(3, 4)), "b": [rng.normal(size=5)]}
    gradients = [
        jax.tree.map(lambda w: rng.normal(size=w.shape) * 10.0 ** rng.integers(-6, 3), start) for _ in range(20)
    ]
    params = jax.tree.map(lambda w: jnp.asarray(w, jnp.float32), start)
    moments = optimizer.init_moments(params)
    step = jax.jit(lambda p, m, g: optimizer.update(settings, p, m, g))
    for g in gradients:
        params, moments = step(params, moments, jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), g))
    assert moments.step == 20
    expected = {
        "a": reference(start["a"], [g["a"] for g in gradients], settings),
        "b": [reference(start["b"][0], [g["b"][0] for g in gradients], settings)],
    }
    for given, wanted in zip(jax.tree.leaves(params), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(given, wanted, rtol=1e-4, atol=1e-5)


def test_decay_is_decoupled() -> None:
    """With a gradient of zero, weights shrink by η λ a step whatever the moments are."""
    settings = AdamW(rate=0.1, steps=1000, decay=0.5)
    params = {"w": jnp.float32([2.0])}
    after, _ = optimizer.update(settings, params, optimizer.init_moments(params), {"w": jnp.zeros(1)})
    np.testing.assert_allclose(after["w"], [2.0 * (1 - 0.1 * 0.5)], rtol=1e-6)


def test_the_rate_rises_peaks_and_falls_to_zero() -> None:
    settings = AdamW(rate=1e-3, steps=100, warmup=10)
    rates = np.array([float(optimizer.rate_at(settings, jnp.int32(step))) for step in (0, 9, 10, 55, 100, 200)])
    np.testing.assert_allclose(rates, [1e-3 / 11, 1e-2 / 11, 1e-3, 5e-4, 0, 0], atol=1e-9)


def test_a_valley_is_descended() -> None:
    settings = AdamW(rate=0.1, steps=300, decay=0.0)
    params = jnp.float32([3.0, -2.0])
    moments = optimizer.init_moments(params)

    def step(state: tuple, _: None) -> tuple:
        params, moments = state
        return optimizer.update(settings, params, moments, 2 * params * jnp.float32([1.0, 100.0])), None

    (params, _), _ = jax.lax.scan(step, (params, moments), None, length=300)
    assert jnp.abs(params).max() < 1e-2
