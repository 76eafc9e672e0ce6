"""See the package."""

import sys

from experiments.completion import judge, train

if __name__ == "__main__":
    command, *arguments = sys.argv[1:] or [""]
    if command not in ("train", "judge"):
        sys.exit(f"expected 'train' or 'judge', given {command!r}")
    (train if command == "train" else judge).command(arguments)
