"""Certified flight paths for UAVs in cities: a Maxwell conduction potential, solved and climbed in pure JAX."""

from maxjax.core.grid import Grid
from maxjax.core.status import Status

__all__ = ["Grid", "Status"]
