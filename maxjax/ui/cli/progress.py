"""Progress on stderr: what is being done, what is compiled for it, how long that took last time, and the time left."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from maxjax.compile.compilation import told
from maxjax.ui.cli.report import console

# Lines of progress in a file of them are this far apart [s].
_QUIET = 5.0


@contextlib.contextmanager
def progress(what: str) -> Iterator[None]:
    """Show what is being done, on a terminal with a running clock."""
    with _shown(what) as show, told(lambda compiling: show(f"{what}: {compiling}" if compiling else what)):
        yield


@contextlib.contextmanager
def telling(first: str) -> Iterator[Callable[[str], None]]:
    """Show how something goes on that tells it itself.

    Yields:
        A function that takes a sentence.
    """
    with _shown(first) as show:
        yield lambda sentence: show(sentence, 0, time.monotonic())


@contextlib.contextmanager
def tally(total: int) -> Iterator[Callable[[int, int, int], None]]:
    """Show how many trials are done, how many of them arrived, and the time left.

    Yields:
        A function (done, arrived, computed) to call as trials finish: how many more, how many of them arrived, and how
        many of them were flown by this process and not read from its folder.
    """
    started = time.monotonic()
    count = _Count(total, started)
    with _shown(count.sentence(), total, started) as show:

        def hear(compiling: str) -> None:
            show(f"{count.sentence()}; {compiling}" if compiling else count.sentence(), count.done)

        def tell(more: int, successes: int, fresh: int) -> None:
            now = time.monotonic()
            count.add(more, successes, fresh, now)
            show(count.sentence(), count.done, now)

        with told(hear):
            yield tell


@contextlib.contextmanager
def _shown(first: str, total: int | None = None, started: float = 0.0) -> Iterator[Callable[..., None]]:
    """A line that changes: on a terminal in place, with a bar where there is a total; in a file now and then.

    Yields:
        A function (sentence, done, now) that changes it; without `now`, what is told is that something compiles.
    """
    where = console(stderr=True)
    if not where.is_terminal:
        yield _Lines(first, total, started)
        return
    bar = () if total is None else (BarColumn(),)
    columns = (SpinnerColumn(), *bar, TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=where, transient=True) as shown:
        task = shown.add_task(first, total=total)
        yield lambda sentence, done=0, now=None: shown.update(task, completed=done, description=sentence)


class _Lines:
    """Lines in a file: the first, what compiles, once, and of the others one in `_QUIET` seconds and the last."""

    def __init__(self, first: str, total: int | None, started: float) -> None:
        self._total, self._since, self._compiled = total, started, False
        self._print(f"{first} ...")

    def __call__(self, sentence: str, done: int = 0, now: float | None = None) -> None:
        if now is None:
            if "compiling" in sentence and not self._compiled:
                self._compiled = True
                self._print(f"{sentence} ...")
        elif done == self._total or now - self._since > _QUIET:
            self._since = now
            self._print(sentence)

    def _print(self, sentence: str) -> None:
        console(stderr=True).print(sentence, highlight=False, soft_wrap=True)


class _Count:
    """How far a campaign is, as a sentence."""

    def __init__(self, total: int, started: float) -> None:
        self.total, self.done = total, 0
        self._arrived, self._started = 0, started
        self._computed: list[tuple[float, int]] = []

    def add(self, more: int, successes: int, fresh: int, now: float) -> None:
        """Count trials; arguments as those of `tally`'s function."""
        self.done, self._arrived = self.done + more, self._arrived + successes
        if fresh:
            self._computed.append((now, fresh))

    def sentence(self) -> str:
        """Trials done, arrived, and the time left where some were computed."""
        text = f"{self.done} of {self.total} trials"
        if self.done:
            text += f", {self._arrived} arrived ({100 * self._arrived / self.done:.1f} %)"
        if not self._computed or self.done == self.total:
            return text
        # The first batch includes compilation: it is left out once there are others.
        counted = self._computed[1:] or self._computed
        since = self._computed[0][0] if len(self._computed) > 1 else self._started
        each = (self._computed[-1][0] - since) / sum(count for _, count in counted)
        return f"{text}, about {_clock(each * (self.total - self.done))} left"


def _clock(seconds: float) -> str:
    """A time to wait, for people."""
    whole = max(round(seconds), 0)
    hours, minutes = whole // 3600, whole // 60 % 60
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {whole % 60:02d} s" if minutes else f"{whole} s"
