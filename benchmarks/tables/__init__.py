"""Tables of the benchmarks' result files, for the README and RESULTS.md.

Each function takes the documents of one table, those that there are: CPU first, then GPU.
"""

from benchmarks.tables.flights import flights, lidar, scaling
from benchmarks.tables.onboard import link_loss, onboard_movers, ros_node
from benchmarks.tables.photographs import inspection
from benchmarks.tables.plans import cities, plans, verdicts
from benchmarks.tables.processes import first_hour, fuzz, history, mutations, page, service, startup
from benchmarks.tables.rivals import rivals
from benchmarks.tables.solves import profile, solves

__all__ = [
    "cities",
    "first_hour",
    "flights",
    "fuzz",
    "history",
    "inspection",
    "lidar",
    "link_loss",
    "mutations",
    "onboard_movers",
    "page",
    "plans",
    "profile",
    "rivals",
    "ros_node",
    "scaling",
    "service",
    "solves",
    "startup",
    "verdicts",
]
