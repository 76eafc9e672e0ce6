"""The paper's own loop in a grid of readings, and what each layer that maxjax adds to the best of them changes.

    python -m experiments.paper_loop --loops exact --trials 6 --maps downtown    # two cores: 3 minutes

On a GPU with 16 cores, each call below 10 minutes; any of them goes on with what KEEP holds:

    export JAX_EXPLICIT_X64_DTYPES=allow        # for the rows in float64
    for k in $(seq 0 17); do
        python -m experiments.paper_loop --shard $k 18 --batch 50 --keep KEEP
    done
    python -m experiments.paper_loop --keep KEEP --record --loops        # flies nothing: the table of what was flown
    for k in $(seq 0 21); do
        python -m experiments.paper_loop --rows layers --trials 1000 --shard $k 22 --batch 250 --keep KEEP
    done
    python -m experiments.paper_loop --rows layers --trials 1000 --keep KEEP --record --loops

The paper (Bong and Beltrame, arXiv:2605.10880) flies by a network's field alone: one scan a plan, the gradients
smoothed by a Gaussian of 5 voxels, climbed by momentum, a reactive layer of 3 m behind it, at most 100 plans. It
reports that every flight arrived. Here the same is flown over the trials of `experiments.closed_loop`, by the networks
that maxjax trained after it (`paper`, `paper_difference`), and by the exact field, of the paper's boundary (κ = 0, also
in float64 and by φ instead of its logarithm) and with a leak. What the paper leaves open is a `Reading`, beside the
sentences that it reads; the grid changes one choice at a time.

To the best reading by the paper's network come the layers, each on top of the last: smoothing that sees walls, steps
that stay out of walls and the discrete step, sweeps, certificate and solver behind them, verification, string pulling,
and prices in place of the dilation; and the whole planner of maxjax, first with the same scan, network and reactive
layer, then with the map of all scans, then by its exact field.

Expected: where paths end before dilated voxels hardly any flight arrives; where they end before occupied ones most do
by the exact field, some with contacts; of the whole planner's flights all do, without one.
"""
