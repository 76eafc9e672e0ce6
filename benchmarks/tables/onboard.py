"""The table of a replanner among movers on board."""

from __future__ import annotations

from benchmarks.common.markdown import Document, device, table


def onboard_movers(*documents: Document) -> str:
    """Of `benchmarks.onboard_movers`."""
    return "\n".join(map(_onboard_movers, documents))


def _onboard_movers(document: Document) -> str:
    (row,), config = [row for row in document["rows"] if row["flight"] == "all"], document["config"]
    shape = " x ".join(map(str, config["shape"]))
    lines = [
        [name, *(f"{row[f'{key}_{share}_ms']:.1f}" for share in ("p50", "p99", "max"))]
        for name, key in (("by a clock", "wall"), ("of all processors", "cpu"))
    ]
    return (
        f"### The loop on board among movers ({device(document)})\n\n"
        f"`maxjax.Replanner` with `movers=` in {shape} voxels of {config['spacing']:g} m, {config['movers']} drones at "
        f"{config['speed']:g} m/s, a cloud every {config['period']:g} s:\n"
        f"{config['flights']} flights of {row['seconds']:.0f} s in all, {row['compilations']} compilations, "
        f"{row['tracks']:.1f} movers followed on average, some flag up for {100 * row['flagged']:.1f} % of the time,\n"
        f"at least {row['least_gap_m']:.2f} m from the middle of the vehicle to any solid. Time of a call [ms]:\n\n"
        + table(["", "median", "99 %", "worst"], lines)
    )


def ros_node(document: Document) -> str:
    """Of `benchmarks.ros_node`."""
    (row,), config = document["rows"], document["config"]
    shape = " x ".join(map(str, config["shape"]))
    delays = [f"{row[f'{share}_ms']:.1f}" for share in ("p50", "p99", "max")]
    return (
        f"### The ROS 2 node ({device(document)})\n\n"
        f"`maxjax ros` in {shape} voxels of {config['spacing']:g} m, a cloud of {row['points']:,} points every "
        f"{config['period']:g} s:\n{row['clouds']} clouds, {row['lost']} without an answer. From the publication of a "
        "cloud to the arrival of its path [ms]:\n\n" + table(["median", "99 %", "worst"], [delays])
    )
