"""What one scan has not seen: how likely it is that a voxel nobody saw is occupied, and what it is worth to know.

    scan → seen occupied, seen free, unseen → network → P(occupied | unseen) → price 1 + a P → path

    python -m experiments.completion.train --record --weights completion.npz    # two cores: 50 minutes; resumes
    python -m experiments.completion.judge --record                             # two cores: an hour

Trained on `midtown` alone, judged on maps that it never saw. Voxels that were seen keep what was seen; the network
enters as price alone, so that a path is certified and verified as any other.
"""
