"""The command line: `maxjax plan`, `mission`, `inspect`, `survey`, `map`, `scan`, `fly`, `view` and others.

    exit code 0:   Status.OK
              1:   another status, whose sentence goes to stderr
              2:   unusable arguments or files
              130: interrupted

`fly` ends with 0 whatever became of its flights: they are what it reports.

Results go to stdout, progress and complaints to stderr.
"""

from __future__ import annotations

from collections.abc import Sequence

from maxjax.core.interruption import end_on_interrupt

_INTERRUPTED = "maxjax: interrupted; all files are whole. `fly --out` and `train` go on from there when run again."


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        arguments: without the program's name. None: those of the process, which Ctrl-C then ends; a caller that passes
            arguments keeps its own handling of Ctrl-C.

    Returns:
        The exit code.

    Raises:
        SystemExit: for `--help` (code 0) and for arguments that cannot be parsed (code 2).
    """
    if arguments is None:
        end_on_interrupt(_INTERRUPTED)
    # Behind the handler, since it imports what takes long.
    from maxjax.ui.cli.commands import run

    return run(arguments)
