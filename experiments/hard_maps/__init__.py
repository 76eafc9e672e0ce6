"""Maps made to be hard, by the million: is a problem solved exactly when SciPy says that its ends are joined?

    python -m experiments.hard_maps --problems 10000 --slice 500 --images 5    # two CPU cores: 90 s
    python -m experiments.hard_maps --problems 1000000 --slice 1000 --images 50 --keep OUT    # 1 hour; resumes

Small maps of 2 m voxels, each drawn from its number alone: random voxels near the percolation threshold; walls whose
doors are narrower than the radius, as wide, or wider; blocks that touch along edges and at corners only; free rims
around a solid; each with ends at centres of voxels, anywhere between them, and on their faces, edges and corners
exactly. A judge that shares no code with maxjax decides by dilation and labels which ends are joined at the radius,
which radius below it joins them, and samples every path densely against the cubes of occupied voxels.

Then the same maps mirrored along an axis and with two axes exchanged, whose paths must be the mirrored ones, and moved
by whole voxels within a solid, and by thousands of metres, whose paths must move along. What counts is the status, and
how much more one path costs than its image (`images`).

Expected: every status right, no path unsafe, no way lost in a mirror.
"""
