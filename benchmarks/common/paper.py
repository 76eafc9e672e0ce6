"""The paper's own figures, Table I, offline: on its own cities, problems and machine.

Bong and Beltrame, arXiv:2605.10880.
"""

# By the map that stands for its city, then by method: mean length [m], its standard deviation [m], run time [s].
PAPER: dict[str, dict[str, tuple[float, float, float]]] = {
    "downtown": {
        "astar": (54.6, 17.8, 0.155),
        "rrtstar": (57.5, 19.6, 17.2),
        "3DMaxConvNet": (58.5, 17.8, 0.089),
    },
    "suburb": {
        "astar": (57.6, 19.8, 0.17),
        "rrtstar": (59.8, 21.8, 17.5),
        "3DMaxConvNet": (59.3, 19.4, 0.087),
    },
}
