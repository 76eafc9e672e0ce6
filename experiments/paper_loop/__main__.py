"""The command `python -m experiments.paper_loop`."""

from benchmarks.common.command import configured
from experiments.paper_loop.study import TINY, main

if __name__ == "__main__":
    main(configured(TINY))
