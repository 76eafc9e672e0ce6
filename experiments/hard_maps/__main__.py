"""The command `python -m experiments.hard_maps`."""

from benchmarks.common.command import configured
from experiments.hard_maps.study import TINY, main

if __name__ == "__main__":
    main(configured(TINY))
