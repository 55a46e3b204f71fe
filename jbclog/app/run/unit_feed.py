"""Units whose serials are read while a run goes on: from lines to events of the run.

A serial begins its unit and ends the one before it; what a station does from then on belongs to it. The same serial again
changes nothing. One that comes back after another was read before, and that is an event: its unit begins again, or, where the
recipe refuses repeats, none does until another serial comes. A line that is too long to be trusted ends the unit as well: whose
joints follow is not known then, and not those of the last one. So does a reader that is gone. Where a pipe was closed in good
order the last unit goes on, and that is said. The unit that a refused serial or a line that is no serial took from the bench
continues when its serial comes next, and that is no repeat.

A unit is *finished* when another serial was read after it: it was made, or put away. Where a number of units is wanted the word
`END_WORD` finishes the last one, too, and what came of it is an event. A refused serial finishes nothing by itself: the unit that
was on the bench is finished by the next serial that is accepted, if that is not its own. One that ended in any other way (a line
that is no serial, a reader that is gone, the end of the run) was begun, and nobody knows whether it was finished; nor was one
that came and went in less than `LEAST_WORK_US`, as in a list that somebody pasted. Each serial counts once. Once so many are
finished as are wanted nothing more is read: a serial that has come all the same is not of this run.

Kinds of events: `unit.begin` and `unit.end` (`raw` is the serial), `unit.again`, `unit.repeated` (a serial that was read before;
`value` is how often it was read by now; an error where it is refused), `unit.finish` (the word that ends a unit), `unit.refused`
(a line that is no serial), `unit.closed`, `unit.lost`, `unit.next` (a serial that is not of this run any more).
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from jbclog.core.rows import EventRow, Severity
from jbclog.transport.typed_lines import LineSource, LineSplitter, SourceLost, TypedLine

LOOK_EVERY_S: Final = 0.1
LOOKS_AT_END: Final = 64  # at what had come and was not read yet
END_WORD: Final = "END"
LEAST_WORK_US: Final = 1_000_000

Keep = Callable[[EventRow], None]


@dataclass(frozen=True, slots=True)
class _Interrupted:
    """A unit that something took from the bench which is no other unit. `is_made`: the next unit shows that it was finished."""

    serial: str
    began: int
    is_made: bool


class UnitFeed:
    """Reads `source` and has `keep` keep what came of it. `micros` gives the time now, UTC microseconds.

    With `wanted` it reads until so many units are finished; `on_bench_at_end` is the one that was not when the run ended. With
    `refuses_repeats` no unit begins twice.
    """

    def __init__(
        self, source: LineSource, keep: Keep, micros: Callable[[], int], wanted: int | None = None, *, refuses_repeats: bool = False
    ) -> None:
        self.unit: str | None = None
        self.on_bench_at_end: str | None = None
        self.has_had_any = False
        self.finished: set[str] = set()
        self._wanted = wanted
        self._refuses_repeats = refuses_repeats
        self._refused: str | None = None  # the serial read last, if it was refused
        self._interrupted: _Interrupted | None = None
        self._times_read: Counter[str] = Counter()
        self._first_read: dict[str, int] = {}
        self._began = 0
        self._source: LineSource | None = source
        self._keep = keep
        self._micros = micros
        self._splitter = LineSplitter()
        self._now = self._looked = micros()

    def look(self) -> bool:
        """Take in what has come since the last look; give whether there was anything. Returns at once."""
        if self._source is None:
            return False
        self._looked, self._now = self._now, self._micros()
        try:
            data = self._source.read()
        except SourceLost as why:
            self._lose(self._source, str(why))
            return False
        if data is None:
            self._close_source(self._source)
        else:
            self._take(*self._splitter.feed(data))
        return bool(data)

    def finish(self) -> None:
        """At the run's end: take in what is there, end the unit, give the source up."""
        for _ in range(LOOKS_AT_END):
            if not self.look():
                break
        self._now = self._micros()
        for line in self._splitter.finish():
            self._tell(
                "unit.refused", f"{line.text} came without the end of its line; it began no unit.", line.text, Severity.WARNING
            )
        self.on_bench_at_end = self.unit
        self._end_unit()
        self._give_up()

    @property
    def is_done(self) -> bool:
        """Whether all units that are wanted are finished."""
        return self._wanted is not None and len(self.finished) >= self._wanted

    def _take(self, *lines: TypedLine) -> None:
        again = 0
        for line in lines:
            if line.is_whole and line.text in (self.unit, self._refused):
                again += 1
                continue
            self._tell_again(again)
            again = 0
            self._change(line)
        self._tell_again(again)
        if self.is_done:
            self._give_up()

    def _change(self, line: TypedLine) -> None:
        self._refused = None
        if not line.is_whole:
            text = f"A line of more than {len(line.text)} characters is no serial; whose joints follow is not known."
            self._tell("unit.refused", text, line.text, Severity.WARNING)
            self._interrupt(is_made=False)
        elif self._wanted is not None and line.text == END_WORD:
            self._end_by_word()
        elif self._is_repeat(line.text) and self._refuses_repeats and not self.is_done:
            self._refuse(line.text)
        else:
            self._next_unit(line)

    def _next_unit(self, line: TypedLine) -> None:
        before = self._interrupted
        continues = before is not None and before.serial == line.text
        if continues:
            self._interrupted = None  # and so not finished by its own serial
        is_repeat = self._is_repeat(line.text) and not continues
        self._finish_unit()
        if self.is_done:
            self._tell("unit.next", f"Serial {line.text} came when all units were finished; it is not of this run.", line.text)
            return
        self._times_read[line.text] += 1
        if is_repeat:
            self._tell_repeat(line.text, "and begins again; each serial counts once", Severity.WARNING)
        self.unit, self.has_had_any = line.text, True
        self._began = before.began if before is not None and continues else self._now
        self._first_read.setdefault(line.text, self._now)
        begins = "continues" if continues else "begins"
        if line.is_clear:
            self._tell("unit.begin", f"Unit {line.text} {begins}.", line.text)
        else:
            text = f"Unit {line.text} {begins}; its serial held what does not show, which stands here as an escape."
            self._tell("unit.begin", text, line.text, Severity.WARNING)

    def _is_repeat(self, serial: str) -> bool:
        """Whether it was read before, and is not that of the unit which was just interrupted."""
        return serial in self._first_read and (self._interrupted is None or self._interrupted.serial != serial)

    def _refuse(self, serial: str) -> None:
        self._refused = serial
        self._times_read[serial] += 1
        self._interrupt(is_made=self._now - self._began >= LEAST_WORK_US)
        before = self._interrupted
        back = "" if before is None else f"; {before.serial} read again continues that one"
        why = f"and is refused, as the recipe says: what follows belongs to no unit until another serial is read{back}"
        self._tell_repeat(serial, why, Severity.ERROR)

    def _tell_repeat(self, serial: str, what: str, severity: Severity) -> None:
        first = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(self._first_read[serial] // 1_000_000))
        text = f"Serial {serial} was read before, at {first} UTC, {what}."
        self._tell("unit.repeated", text, serial, severity, value=self._times_read[serial])

    def _end_by_word(self) -> None:
        """Say what came of it: what a barcode reader types is not shown by itself."""
        before = None if self._interrupted is None else self._interrupted.serial
        unit = self.unit or before
        self._finish_unit()
        if unit is None:
            text = f"{END_WORD} was read, and no unit is on the bench."
        elif unit in self.finished:
            text = f"{END_WORD} was read: unit {unit} is finished."
        else:
            text = f"{END_WORD} was read: unit {unit} ends and is not counted as finished."
        self._tell("unit.finish", f"{text} Units finished: {len(self.finished)}, wanted: {self._wanted}.", unit)

    def _tell_again(self, times: int) -> None:
        if times:
            whose = f"The serial of unit {self.unit}" if self._refused is None else f"Serial {self._refused}, which is refused,"
            self._tell("unit.again", f"{whose} came again; nothing changes.", self.unit or self._refused, value=times)

    def _finish_unit(self) -> None:
        """Another serial was read: the unit on the bench has been made, or the one that was interrupted before."""
        if self.unit is not None and self._now - self._began >= LEAST_WORK_US:
            self.finished.add(self.unit)
        elif self.unit is None and self._interrupted is not None and self._interrupted.is_made:
            self.finished.add(self._interrupted.serial)
        self._interrupted = None
        self._end_unit()

    def _interrupt(self, *, is_made: bool) -> None:
        """End the unit on the bench so that it may come back."""
        if self.unit is not None:
            self._interrupted = _Interrupted(self.unit, self._began, is_made)
        self._end_unit()

    def _end_unit(self) -> None:
        if self.unit is not None:
            self._tell("unit.end", f"Unit {self.unit} ends.", self.unit)
            self.unit = None

    def _close_source(self, source: LineSource) -> None:
        self._take(*self._splitter.finish())
        going_on = f"unit {self.unit} goes on to the end of the run" if self.unit else "there is no unit from here on"
        text = f"No more serials come from {source.name}, which was closed: {going_on}.{self._too_few}"
        self._tell("unit.closed", text, None, Severity.WARNING)
        self._give_up()

    def _lose(self, source: LineSource, why: str) -> None:
        text = f"No more serials can be read from {source.name}: {why}. Whose joints follow is not known.{self._too_few}"
        self._tell("unit.lost", text, None, Severity.WARNING)
        self._end_unit()
        self._give_up()

    @property
    def _too_few(self) -> str:
        return "" if self._wanted is None or self.is_done else " The wanted number of units cannot be reached any more."

    def _give_up(self) -> None:
        if self._source is not None:
            self._source.close()
            self._source = None

    def _tell(self, kind: str, text: str, raw: str | None, severity: Severity = Severity.INFO, value: float | None = None) -> None:
        earliest = self._looked if self._looked < self._now else None
        self._keep(EventRow(self._now, kind, severity, text, earliest=earliest, value=value, raw=raw))
