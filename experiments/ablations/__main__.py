"""The command `python -m experiments.ablations`."""

import tyro

from experiments.ablations.study import Config, main

if __name__ == "__main__":
    main(tyro.cli(Config))
