"""The command `python -m experiments.ablations`."""

from benchmarks.common.command import configured
from experiments.ablations.study import TINY, main

if __name__ == "__main__":
    main(configured(TINY))
