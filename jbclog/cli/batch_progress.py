"""What a batch shows while it goes on: a table with a line for each job that runs, or plain lines. Nothing here can disturb it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from jbclog.app.batch.entry import State
from jbclog.cli.batch_wording import local, seconds, span
from jbclog.cli.output import is_terminal, note, wrapped
from jbclog.cli.progress import Worth, event_line
from jbclog.core.text import clean

if TYPE_CHECKING:
    from rich.live import Live
    from rich.table import Table

    from jbclog.app.batch.job_dir import JobDir, Now
    from jbclog.app.batch.queue import Next
    from jbclog.app.batch.resume import Shift
    from jbclog.app.batch.state import BatchState, JobState
    from jbclog.config.jobs_file import JobTable

SHOW_EVERY_S: Final = 1.0
COLUMNS: Final = ("job", "stations", "so far", "now", "tools", "alarms")


class _Follower:
    """The events of one job that are worth telling, as they come."""

    def __init__(self, papers: JobDir) -> None:
        self.papers = papers
        self._worth = Worth()
        self._read = 0

    def news(self) -> Iterator[str]:
        events, self._read = self.papers.events(self._read)
        for event in events:
            if self._worth.telling(event):
                yield event_line(event)


class Lines:
    """For a log or a pipe: a line for each job that begins or ends, and for each event that is worth telling."""

    def __init__(self, shift: Shift) -> None:
        self._shift = shift
        self._followed: dict[str, _Follower] = {}
        self._recording: set[str] = set()
        self._shown = 0.0

    def started(self, job: JobState) -> None:
        again = "" if len(job.attempts) == 1 else ", again, as a new run"
        self.told(f"{job.name} begins on {', '.join(self._shift.orders.stations[job.name])}{again}")

    def ended(self, job: JobState) -> None:
        self._tell_news(job)
        self._followed.pop(job.name, None)
        if job.state is State.SKIPPED or job.last is None:
            self.told(job.text.rstrip("."))
            return
        took = span(seconds(job.last.ended or job.last.began) - seconds(job.last.began))
        why = f": {job.text}" if job.text else ""
        self.told(f"{job.name} ended after {took}, {job.state.value}, exit code {job.last.exit_code}{why}")

    def told(self, text: str) -> None:
        self._print(f"{time.strftime('%H:%M:%S')}  {text}")

    def look(self, standing: BatchState, following: Next) -> None:
        now = time.monotonic()
        if now - self._shown >= SHOW_EVERY_S:
            self._shown = now
            for job in standing.running():
                self._tell_run(job)
                self._tell_news(job)
            self._second(standing, following)

    def close(self) -> None:
        return

    def _tell_run(self, job: JobState) -> None:
        run = job.last and job.last.run
        if run and run not in self._recording:
            self._recording.add(run)
            self.told(f"{job.name} records into {run}")

    def _tell_news(self, job: JobState) -> None:
        for text in self._follow(job).news():
            self._print(f"{job.name}: {text}")

    def _follow(self, job: JobState) -> _Follower:
        papers = self._shift.hands.papers(job.name, max(len(job.attempts), 1))
        known = self._followed.get(job.name)
        if known is None or known.papers.folder != papers.folder:
            known = self._followed[job.name] = _Follower(papers)
        return known

    def _now(self, job: JobState) -> Now:
        return self._follow(job).papers.now()

    def _print(self, text: str) -> None:
        note(text)

    def _second(self, standing: BatchState, following: Next) -> None:
        return


class Screen(Lines):
    """For a person: a table that is renewed each second, what happens above it."""

    def __init__(self, shift: Shift) -> None:
        from rich.console import Console
        from rich.live import Live

        super().__init__(shift)
        self._asked: dict[str, JobTable] = {job.name: job for job in shift.orders.file.jobs}
        self._console = Console(stderr=True, no_color="NO_COLOR" in os.environ, highlight=False)
        # stdout is for data: what is told there must not be shown on stderr because a table is
        self._live: Live | None = Live(
            console=self._console, auto_refresh=False, transient=True, redirect_stdout=False, redirect_stderr=False
        )
        self._live.start()

    def close(self) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _print(self, text: str) -> None:
        self._console.print(wrapped(clean(text), self._console.width), markup=False, soft_wrap=True)

    def _second(self, standing: BatchState, following: Next) -> None:
        if self._live is not None:
            self._live.update(self._table(standing, following), refresh=True)

    def _table(self, standing: BatchState, following: Next) -> Table:
        from rich.table import Table

        table = Table(title=clean(title(standing, following)), title_justify="left", pad_edge=False)
        for name in COLUMNS:
            table.add_column(name, justify="right" if name == "alarms" else "left")
        for job in standing.running():
            table.add_row(*map(clean, self._cells(job, self._now(job))))
        return table

    def _cells(self, job: JobState, now: Now) -> tuple[str, ...]:
        stations = ", ".join(self._shift.orders.stations[job.name])
        away = f"; away: {', '.join(now.away)}" if now.away else ""
        return job.name, stations, so_far(self._asked[job.name], now), now.doing + away, tools(now), str(now.alarms or "")


def title(standing: BatchState, following: Next) -> str:
    """``2 of 9 jobs have ended; next smd-2 (dde-1: behind smd-1)``."""
    ended = sum(job.is_over for job in standing.jobs.values())
    text = f"{ended} of {len(standing.jobs)} jobs have ended"
    if not following.wait:
        return text
    first = following.wait[0]
    why = first.why if first.until is None else f"waits until {local(first.until)}"
    more = f", and {len(following.wait) - 1} more" if len(following.wait) > 1 else ""
    return f"{text}; next {first.name} ({why}){more}"


def so_far(asked: JobTable, now: Now) -> str:
    """How far a job has come towards its end."""
    passed = span(now.passed_s) + (f" of {asked.duration}" if asked.duration else "")
    if asked.units is not None:
        return f"{now.units} of {asked.units} units, {passed}"
    return passed if asked.joints is None else f"{passed}, to {asked.joints} joints"


def tools(now: Now) -> str:
    """What the tools do and how warm they are: ``working 346 to 352 °C``."""
    states = dict.fromkeys(port.status for port in now.ports if port.status)
    known = sorted(port.temperature_c for port in now.ports if port.temperature_c is not None)
    warm = "" if not known else f"{known[0]:g} °C" if known[0] == known[-1] else f"{known[0]:g} to {known[-1]:g} °C"
    return " ".join(part for part in (", ".join(states), warm) if part)


def shown_by(shift: Shift, *, quiet: bool) -> Lines | Screen:
    """The table on a terminal, lines elsewhere or where stdout is for a program."""
    return Screen(shift) if is_terminal() and not quiet else Lines(shift)
