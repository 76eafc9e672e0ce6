"""The page of a folder of flights: its trials as a list, one of them on a timeline.

trial → Film → stage; a thread moves the vehicle while it plays
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from maxjax.core.status import Status
from maxjax.sim.loop.flight import Flight
from maxjax.sim.trials.cities import Where
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome
from maxjax.sim.trials.trial_movers import movers_of
from maxjax.ui.page.draw import ground_scene
from maxjax.ui.page.nodes import Scene
from maxjax.ui.page.server import aim, look_at, set_theme
from maxjax.ui.page.stage import Stage
from maxjax.ui.page.timeline import VEHICLE_NODE, Film
from maxjax.ui.page.trial_folder import city_of, film_of, headline, trial_in_words
from maxjax.ui.page.worker import Worker

if TYPE_CHECKING:
    from viser import ViserServer

_FRAME = 0.05  # between two pictures while it plays [s]
_SPEEDS = ("0.5x", "1x", "2x", "4x", "8x")
LEGEND = (
    '<div style="font-size:0.8em;padding:0 0.9em 0.4em"><b style="color:#0072B2">━━</b> flown '
    '<b style="color:#D55E00">━━</b> failed <b style="color:#009E73">━━</b> plan '
    '<b style="color:#CC79A7">━━</b> reference, or committed motion<br><b style="color:#56B4E9">■</b> map so far '
    '<b>·</b> scan <b style="color:#A848D0">■</b> mover <b style="color:#A848D0">□</b> may hold one now, '
    "veiled: within the horizon</div>"
)
Again = Callable[[Outcome], Sequence[Flight]]
"""Flies a trial again: the flight before its first period and after each."""


class FlightPage:
    """A page to play flights on; it answers as long as its server runs.

    Args:
        server: with an empty scene.
        where: the trials were flown.
        ledger: outcomes and positions.
        again: flies a trial again.
        trial: to begin with.
        dark: whether the page is dark.
    """

    def __init__(
        self, server: ViserServer, where: Where, ledger: Ledger, again: Again, trial: int, *, dark: bool = False
    ) -> None:
        self._server, self._where, self._ledger, self._again = server, where, ledger, again
        self._lines: Mapping[int, Float[np.ndarray, "t 3"]] = ledger.positions()
        self._stage, self._shown = Stage(server.scene), dict[str, Scene]()
        self._flights: dict[int, Sequence[Flight]] = {}
        self._lock = threading.RLock()
        self.film: Film | None = None
        """The film that plays; None for a trial that was not flown."""
        self._controls(trial, dark)
        self.worker: Worker[tuple[int, bool]] = Worker(self._open)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self.worker.ask((trial, False))

    def close(self) -> None:
        """End its threads."""
        self._ended.set()
        self.worker.close()

    def _controls(self, trial: int, dark: bool) -> None:
        gui, outcomes = self._server.gui, self._ledger.outcomes
        self._names = {headline(outcomes[k]): k for k in sorted(outcomes)}
        flown = [one for one in outcomes.values() if one.flown]
        arrived = sum(one.status == Status.OK.name for one in flown)
        gui.add_markdown(f"{arrived} of {len(flown)} flights arrived.")
        with gui.add_folder("Trials"):
            self.failed = gui.add_checkbox("Failures only", False, disabled=arrived == len(flown))
            first = headline(outcomes[trial])
            self.list = gui.add_dropdown("Trial", tuple(self._names), initial_value=first)
        self.status = gui.add_markdown("")
        gui.add_html(LEGEND)
        with gui.add_folder("Time"):
            self.time: Any = gui.add_slider("Time [s]", min=0.0, max=1.0, step=0.05, initial_value=0.0)
            self.play = gui.add_button("Pause")
            self.speed = gui.add_dropdown("Speed", _SPEEDS, initial_value="1x")
        self.more = gui.add_button("Fly it again: scan, map and plans")
        self.dark = gui.add_checkbox("Dark page", dark)
        self.playing = True
        self.list.on_update(lambda _: self.worker.ask((self._names[self.list.value], False)))
        self.more.on_click(lambda _: self.worker.ask((self._names[self.list.value], True)))
        self.failed.on_update(lambda _: self._filter())
        self.play.on_click(lambda _: self.pause(self.playing))
        self.time.on_update(lambda event: self._sought(event))
        self.dark.on_update(lambda _: self._darken())

    def pause(self, paused: bool) -> None:
        """Stop playing, or go on."""
        self.playing = not paused
        self.play.label = "Play" if paused else "Pause"

    def _darken(self) -> None:
        set_theme(self._server, dark=self.dark.value)
        with self._lock:
            if self.film is not None:
                city = city_of(self._where, self._ledger.outcomes[self._trial].city)
                self._stage.show("/map/ground", ground_scene(city, dark=self.dark.value))

    def _filter(self) -> None:
        outcomes, only = self._ledger.outcomes, self.failed.value
        names = [n for n, k in self._names.items() if not only or outcomes[k].status != Status.OK.name]
        self.list.options = tuple(names)

    def _sought(self, event: Any) -> None:
        """A hand on the slider stops the film there; what the film itself moved has no client."""
        if event.client is not None:
            self.pause(True)
            self.show(float(self.time.value))

    def _open(self, asked: tuple[int, bool]) -> None:
        trial, again = asked
        outcome = self._ledger.outcomes[trial]
        if again and outcome.flown and trial not in self._flights:
            self.status.content = f"### Trial {trial}: flying again …\nIts programs are compiled first, once."
            try:
                self._flights[trial] = self._again(outcome)
            except ValueError as error:
                self.status.content = f"### Trial {trial}: not flown again\n{error}"
                return
        line = self._lines.get(trial)
        self.status.content = f"### Trial {trial}\nIts city and what moves there are computed …"
        with self._lock:
            if not outcome.flown or line is None:
                self.film, self._shown = None, {}
                self._stage.show("/", {})
                self.status.content = trial_in_words(outcome)
                return
            city = city_of(self._where, outcome.city)
            flights, movers = self._flights.get(trial, ()), movers_of(self._ledger.configuration, outcome, self._where)
            self._trial = trial
            self.film, self._shown = film_of(outcome, line, city, flights, movers), {}
            ends = city.frame.page(np.array([outcome.start, outcome.goal], np.float64))
            look_at(self._server, city, np.concatenate([self.film.positions, ends]))
            for client in self._server.get_clients().values():
                aim(self._server, client)
            self.time.max = max(self.film.duration, 0.1)
            self.time.value = 0.0
            with self._server.atomic():
                self._stage.show("/", {**self.film.begin(), **ground_scene(city, dark=self.dark.value)})
                self.status.content = trial_in_words(outcome)
        self.pause(False)
        self.show(0.0)

    def show(self, moment: float) -> None:
        """Show the film at a time [s]."""
        with self._lock:
            if self.film is None:
                return
            shown = self.film.showing(moment)
            with self._server.atomic():
                for part, nodes in shown.items():
                    if self._shown.get(part) is not nodes:
                        self._stage.show(part, nodes)
                self._stage.move(VEHICLE_NODE, self.film.vehicle(moment))
            self._shown = shown

    def _run(self) -> None:
        """Let time pass while it plays; at the end it begins again."""
        before = time.monotonic()
        while not self._ended.wait(_FRAME):
            now = time.monotonic()
            passed, before = now - before, now
            film = self.film
            if self.playing and film is not None:
                moment = float(self.time.value) + passed * float(self.speed.value[:-1])
                moment = moment if moment <= film.duration else 0.0
                self.time.value = moment
                self.show(moment)
