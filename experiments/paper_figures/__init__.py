"""Figures 1 to 5 of the paper (Bong and Beltrame, arXiv 2605.10880), drawn anew from our own runs.

    python -m experiments.paper_figures --out docs/figures                                  # 2 minutes on two CPU cores
    python -m experiments.closed_loop --trials 50 --keep OUT                                # one H200, for figure 5
    python -m experiments.paper_figures --only flights --flights OUT/downtown-solver-calm OUT/suburb-solver-calm

1. `paper_path`: a path that follows the field between buildings.    2. `paper_training_map`: the training map.
3. `paper_architecture`: both networks, from their configurations.   4. `paper_fields`: fields on both unseen maps.
5. `paper_flights`: the worst flights of campaigns, by what they flew over the straight distance.

Problems are those of the offline protocol (`experiments.random_problems`), of the first city of a map: of those with
the largest margin the one with the longest detour. Fields are cut at the height of the goal, which a path may leave.
Where the paper shows what its network predicts, this shows the certified potential of the solver. Every figure is a PNG
below 250 kB; axes are in metres.
"""
