"""The command `maxjax fly` as tests run it."""

from __future__ import annotations

import pytest

from maxjax.cli import main


class Terminal:
    """Runs `maxjax fly` in this process."""

    def __init__(self, capfd: pytest.CaptureFixture[str]) -> None:
        self._capfd = capfd

    def __call__(self, *arguments: object) -> tuple[int, str, str]:
        """Exit code, stdout, stderr."""
        self._capfd.readouterr()
        try:
            code = main(["fly", *(str(argument) for argument in arguments)])
        except SystemExit as stop:
            code = int(stop.code or 0)
        out, err = self._capfd.readouterr()
        assert "Traceback" not in out + err
        return code, out, err
