"""Scans and flights in batches, and what several devices make of work."""

from __future__ import annotations

from benchmarks.common.markdown import Document, device, number, table


def lidar(*documents: Document) -> str:
    """Of `benchmarks.lidar`."""
    methods = ("fused kernel", "scan: fused kernel, noise, dropout", "vmapped mjx.ray", "C mj_multiRay")
    lines = []
    for document in documents:
        for name in document["config"]["maps"]:
            rows = {row["method"]: row for row in document["rows"] if row["map"] == name}
            off = " / ".join(str(rows[method]["rays_off_by_1mm"]) for method in (methods[0], methods[2]))
            times = [number(rows[method]["median_ms"]) for method in methods]
            lines.append([name, device(document), str(rows[methods[0]]["geoms"]), *times, off])
    rays = documents[0]["config"]["rays"]
    heads = ["map", "on", "geoms", "fused kernel", "with noise", "`mjx.ray`", "C `mj_multiRay`", "off"]
    return (
        "### LiDAR\n\n"
        f"One scan of {rays:,} rays: median [ms]. With noise: the fused kernel with range noise and dropout.\n"
        "`mjx.ray` runs under `vmap`, C MuJoCo on one thread of the machine's CPU. Off: rays of the fused kernel / of\n"
        "`mjx.ray` that differ from C `mj_ray` by more than a millimetre within range.\n\n"
        + table(heads, lines, left=2)
    )


_CAMPAIGNS = (
    "\nWhole campaigns, from drawing the trials to outcomes on the host; the same: outcomes that are so, to the\n"
    "millimetre, where these flights fly without the others.\n\n"
)


def flights(*documents: Document) -> str:
    """Of `benchmarks.flight`."""
    lines: list[list[str]] = []
    campaigns: list[list[str]] = []
    stages: list[list[str]] = []
    for document in documents:
        for row in document["rows"]:
            what, name = row["what"].split(", ")
            if what in ("flights", "campaign"):
                figures = [number(row[key]) for key in ("seconds", "flights_per_s")]
                cells = [name, device(document), str(row["batch"]), *figures, str(row["arrived"])]
                same = [f"{row['same']} of {row['alone']}"] if what == "campaign" else []
                (campaigns if same else lines).append([*cells, *same])
        for name in document["config"]["maps"]:
            found = [row for row in document["rows"] if row["what"].startswith(f"stage, {name}: ")]
            if found:
                shares = [f"{row['ms_per_flight']:.3f}" for row in found]
                stages.append([name, device(document), str(found[0]["batch"]), *shares])
    heads = ["map", "on", "flights", "seconds", "flights a second", "arrived"]
    return (
        "### Flights in batches\n\n"
        "Whole flights, 50 to 80 m, from drawn worlds to logs on the host, all of a batch in one call; compilation\n"
        "apart.\n\n"
        + table(heads, lines, left=2)
        + (_CAMPAIGNS + table([*heads, "the same"], campaigns, left=2) if campaigns else "")
        + "\nOne planning iteration by stage, in a batch under way [ms a flight]:\n\n"
        + table(["map", "on", "flights", "sense", "fuse", "plan", "follow"], stages, left=2)
    )


def scaling(*documents: Document) -> str:
    """Of `benchmarks.flight --devices`, `benchmarks.training` and `benchmarks.city_scale`."""
    lines = []
    for document in documents:
        single: dict[str, float] = {}
        for row in document["rows"]:
            if "flights_per_s" in row:
                what = f"{row['batch'] // row['devices']} flights a device, {row['what'].removeprefix('devices, ')}"
                figure, rate = f"{row['flights_per_s']:.1f} a second", row["flights_per_s"]
            elif "seconds_an_epoch" in row:
                what = f"{row['what']}, batch of {row['batch']}"
                figure, rate = f"{row['seconds_an_epoch']:.2f} s an epoch", 1 / row["seconds_an_epoch"]
            elif "median" in row:
                what = f"potential of a city, {' × '.join(map(str, document['config']['shape']))}"
                figure, rate = f"{row['median']:.0f} ms", 1 / row["median"]
            else:
                continue
            times = rate / single.setdefault(what, rate / row["devices"])
            lines.append([what, str(row["devices"]), figure, f"{times:.2f}", f"{times / row['devices']:.2f}"])
    kinds = ", ".join(dict.fromkeys(str(d["provenance"]["device"]).split(" x ")[-1] for d in documents))
    flown = any("flights_per_s" in row for document in documents for row in document["rows"])
    flights = "Flights: as many on each device (weak scaling). " if flown else ""
    return (
        f"### Several devices ({kinds})\n\n"
        f"{flights}Training and city: the same work, split (strong scaling).\n\n"
        + table(["what", "devices", "", "times one device", "of linear"], lines)
    )
