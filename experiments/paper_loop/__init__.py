"""The paper's own loop, as it stands, and what each layer that maxjax adds saves.

    python -m experiments.paper_loop --trials 2 --loops paper                     # two cores: 5 minutes
    python -m experiments.paper_loop --trials 1000 --batch 50 --keep OUT          # one GPU, hours; resumes
    python -m experiments.paper_loop --trials 1000 --keep OUT --loops             # flies nothing: what was flown so far

The paper (Bong and Beltrame, arXiv:2605.10880) flies by a network's field alone: one scan a plan, the gradients
smoothed by a Gaussian of 5 voxels, climbed by momentum, each path flown as far as the ascent came, a reactive layer of
3 m behind it, at most 100 plans. It reports that every flight arrived. Here the same is flown over the trials of
`experiments.closed_loop`, by the networks that maxjax trained after it (`paper`, `paper_difference`), by maxjax's, and
by the exact field, of the paper's boundary (κ = 0) and screened.

What the paper does not say is read in two ways, each a loop of its own:

- `gradients`: gradients are taken of the field outside walls, are zero within, and both are smoothed.
- `field`: walls hold the least value of the field, so that their gradients point away from them and repel.

The reactive layer is maxjax's (`sim.loop.reactive`): it pushes across the way and brakes, but never turns the vehicle
round. Then come the layers, each on top of the last: the last 10 m flown straight (both ends are 10 m clear of
buildings), smoothing that sees walls, steps that stay out of walls and the discrete step, sweeps, certificate and
solver behind them, verification; and the whole planner of maxjax, first with the same scan, network and reactive layer,
then with the map of all scans, then by its exact field.

A flight whose plan leads nowhere ten times in a row, at rest, is over: it would be the same for ever.

Expected: no contact; the paper's loop arrives in few flights by any field, the whole planner in all.
"""
