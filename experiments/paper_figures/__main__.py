"""The command `python -m experiments.paper_figures`."""

from benchmarks.common.command import configured
from experiments.paper_figures.study import TINY, main

if __name__ == "__main__":
    main(configured(TINY))
