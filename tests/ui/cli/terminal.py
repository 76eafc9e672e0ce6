"""The command line as tests run it."""

from __future__ import annotations

import pytest

from maxjax.ui.cli import main


class Terminal:
    """Runs the command line in this process; `begin` stands before what each call is given, as a command's name."""

    def __init__(self, capfd: pytest.CaptureFixture[str], *begin: str) -> None:
        self._capfd, self._begin = capfd, begin

    def __call__(self, *arguments: object) -> tuple[int, str, str]:
        """Exit code, stdout, stderr."""
        self._capfd.readouterr()
        try:
            code = main([*self._begin, *(str(argument) for argument in arguments)])
        except SystemExit as stop:
            code = int(stop.code or 0)
        out, err = self._capfd.readouterr()
        assert "Traceback" not in out + err
        return code, out, err
