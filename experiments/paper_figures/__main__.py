"""The command `python -m experiments.paper_figures`."""

import tyro

from experiments.paper_figures.study import Config, main

if __name__ == "__main__":
    main(tyro.cli(Config))
