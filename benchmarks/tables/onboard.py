"""Tables of what runs on board and of the link to a vehicle."""

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


def link_loss(document: Document) -> str:
    """Of `benchmarks.link_loss`."""
    rows, config = document["rows"], document["config"]
    lines = [
        [
            f"{100 * row['loss']:.0f} %",
            f"{1000 * row['delay']:.0f}",
            *(f"{_number(row[f'{name}_median_s'], 3)} / {_number(row[f'{name}_worst_s'], 3)}" for name in _ANSWERED),
            f"{row['transfers_failed']} / {row['commands_failed']} / {row['flights_ended']}",
            *(_number(row[key], digits) for key, digits in (("error_m", 2), ("off_path_m", 2), ("later_s", 1))),
        ]
        for row in rows
    ]
    return (
        f"### The link over a bad radio ({device(document)})\n\n"
        "Over loopback, with a share of the packets lost each way and as many doubled, and each late by so much each "
        "way.\nTransfer: a mission of six items and a rally point sent, the mission read back and compared; command: "
        f"until it is answered.\n{config['transfers']} transfers, {config['commands']} commands and "
        f"{config['flights']} flights a row; a flight follows set-points round a corner at 8 m/s by the clock that "
        f"waits,\ntolerance {config['tolerance']:g} m, and its columns are the worst of both.\n\n"
        + table(
            ["lost", "late [ms]", "transfer [s]: median / worst", "command [s]: median / worst",
             "failed: transfers / commands / flights", "from the set-point [m]", "off the path", "later [s]"],
            lines,
        )
    )  # fmt: skip


_ANSWERED = ("transfer", "command")


def _number(value: float | None, digits: int) -> str:
    text = "" if value is None else f"{value:.{digits}f}"
    return text if text and float(text) else text.lstrip("-")
