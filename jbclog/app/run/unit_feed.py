"""Reads the serials of units during a run and records them as events.

- A serial begins its unit and ends the one before it; the rows of a station from then on belong to
  it. The same serial again has no effect.
- A serial that was read before, with another one in between, is a repeat: its unit begins again,
  or, if the recipe refuses repeats, no unit does until another serial comes.
- A line that is not a serial, or a lost reader, ends the unit: the following joints belong to no
  known unit. After a pipe that was closed in good order the last unit continues.
- A unit interrupted by a refused serial or a line that is not a serial continues when its serial
  comes next; that is not a repeat.

A unit is *finished* when another serial is read after it. If a number of units is wanted, the word
`END_WORD` also finishes the last one. A refused serial finishes nothing by itself: the interrupted
unit is finished by the next accepted serial, unless that is its own. A unit that ended in any other
way is not known to be finished; nor is one shorter than `LEAST_WORK_US`, as in a pasted list. Each
serial counts once. After the wanted number nothing more is read: a later serial does not belong to
this run.

Kinds of events: `unit.begin` and `unit.end` (`raw` is the serial), `unit.again`, `unit.repeated`
(`value` is how often it was read by now; an error if refused), `unit.finish` (the word that ends a
unit), `unit.refused` (a line that is not a serial), `unit.closed`, `unit.lost`, `unit.next` (a
serial that does not belong to this run).
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
LOOKS_AT_END: Final = 64  # looks at lines that are not read yet
END_WORD: Final = "END"
LEAST_WORK_US: Final = 1_000_000
NUL_SHOWN: Final = r"\x00"  # a zero byte as `typed_lines` shows it

Keep = Callable[[EventRow], None]


def unit_after(event: EventRow, unit: str | None) -> str | None:
    """Return the unit on the bench after `event`; `unit` was there before."""
    return event.raw if event.kind == "unit.begin" else None if event.kind == "unit.end" else unit


@dataclass(frozen=True, slots=True)
class _Interrupted:
    """A unit interrupted by something other than a unit. `is_made`: the next unit shows that it was
    finished.
    """

    serial: str
    began: int
    is_made: bool


class UnitFeed:
    """Reads `source` and passes events to `keep`. `micros` returns the time, UTC microseconds.

    With `wanted`, reads until that many units are finished; `on_bench_at_end` is the unfinished one
    at the end of the run. With `refuses_repeats` no unit begins twice.
    """

    def __init__(
        self,
        source: LineSource,
        keep: Keep,
        micros: Callable[[], int],
        wanted: int | None = None,
        *,
        refuses_repeats: bool = False,
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
        """Process new lines; return whether there were any. Never waits."""
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
        """Process what is left, end the unit and close the source, at the end of the run."""
        for _ in range(LOOKS_AT_END):
            if not self.look():
                break
        self._now = self._micros()
        for line in self._splitter.finish():
            self._note(
                "unit.refused",
                f"{line.text} came without a line end; it began no unit.",
                line.text,
                Severity.WARNING,
            )
        self.on_bench_at_end = self.unit
        self._end_unit()
        self._give_up()

    @property
    def is_done(self) -> bool:
        """Whether all wanted units are finished."""
        return self._wanted is not None and len(self.finished) >= self._wanted

    def _take(self, *lines: TypedLine) -> None:
        again = 0
        for line in lines:
            if line.is_whole and line.text in (self.unit, self._refused):
                again += 1
                continue
            self._note_again(again)
            again = 0
            self._change(line)
        self._note_again(again)
        if self.is_done:
            self._give_up()

    def _change(self, line: TypedLine) -> None:
        self._refused = None
        if not line.is_whole:
            text = (
                f"A line of more than {len(line.text)} characters is not a serial; the joints that"
                " follow belong to no known unit."
            )
            self._note("unit.refused", text, line.text, Severity.WARNING)
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
            self._interrupted = None  # its own serial does not finish it
        is_repeat = self._is_repeat(line.text) and not continues
        self._finish_unit()
        if self.is_done:
            self._note(
                "unit.next",
                f"Serial {line.text} came when all units were finished; it does not count.",
                line.text,
            )
            return
        self._times_read[line.text] += 1
        if is_repeat:
            self._note_repeat(
                line.text, "and begins again; each serial counts once", Severity.WARNING
            )
        self.unit, self.has_had_any = line.text, True
        self._began = before.began if before is not None and continues else self._now
        self._first_read.setdefault(line.text, self._now)
        begins = "continues" if continues else "begins"
        if line.is_clear:
            self._note("unit.begin", f"Unit {line.text} {begins}.", line.text)
        else:
            text = (
                f"Unit {line.text} {begins}; hidden characters in its serial are shown as escapes."
            )
            if NUL_SHOWN in line.text:
                text += " The source seems to send UTF-16; set it to UTF-8."
            self._note("unit.begin", text, line.text, Severity.WARNING)

    def _is_repeat(self, serial: str) -> bool:
        """Whether the serial was read before, and is not the unit that was just interrupted."""
        return serial in self._first_read and (
            self._interrupted is None or self._interrupted.serial != serial
        )

    def _refuse(self, serial: str) -> None:
        self._refused = serial
        self._times_read[serial] += 1
        self._interrupt(is_made=self._now - self._began >= LEAST_WORK_US)
        before = self._interrupted
        back = "" if before is None else f"; {before.serial} read again continues that one"
        why = (
            "and is refused, as the recipe says: what follows belongs to no unit until another"
            f" serial is read{back}"
        )
        self._note_repeat(serial, why, Severity.ERROR)

    def _note_repeat(self, serial: str, what: str, severity: Severity) -> None:
        first = time.strftime(
            "%Y-%m-%d %H:%M:%S", time.gmtime(self._first_read[serial] // 1_000_000)
        )
        text = f"Serial {serial} was read before, at {first} UTC, {what}."
        self._note("unit.repeated", text, serial, severity, value=self._times_read[serial])

    def _end_by_word(self) -> None:
        """Record the result as an event: a barcode reader shows nothing itself."""
        before = None if self._interrupted is None else self._interrupted.serial
        unit = self.unit or before
        self._finish_unit()
        if unit is None:
            text = f"{END_WORD} was read, and no unit is on the bench."
        elif unit in self.finished:
            text = f"{END_WORD} was read: unit {unit} is finished."
        else:
            text = f"{END_WORD} was read: unit {unit} ends and is not counted as finished."
        self._note(
            "unit.finish",
            f"{text} Units finished: {len(self.finished)}, wanted: {self._wanted}.",
            unit,
        )

    def _note_again(self, times: int) -> None:
        if times:
            whose = (
                f"The serial of unit {self.unit}"
                if self._refused is None
                else f"Serial {self._refused}, which is refused,"
            )
            self._note(
                "unit.again",
                f"{whose} came again; nothing changes.",
                self.unit or self._refused,
                value=times,
            )

    def _finish_unit(self) -> None:
        """End the unit on the bench; it, or the interrupted one before, is finished."""
        if self.unit is not None and self._now - self._began >= LEAST_WORK_US:
            self.finished.add(self.unit)
        elif self.unit is None and self._interrupted is not None and self._interrupted.is_made:
            self.finished.add(self._interrupted.serial)
        self._interrupted = None
        self._end_unit()

    def _interrupt(self, *, is_made: bool) -> None:
        """End the unit on the bench so that it can continue."""
        if self.unit is not None:
            self._interrupted = _Interrupted(self.unit, self._began, is_made)
        self._end_unit()

    def _end_unit(self) -> None:
        if self.unit is not None:
            self._note("unit.end", f"Unit {self.unit} ends.", self.unit)
            self.unit = None

    def _close_source(self, source: LineSource) -> None:
        self._take(*self._splitter.finish())
        rest = (
            f"unit {self.unit} lasts until the end of the run"
            if self.unit
            else "the rest of the run has no unit"
        )
        text = f"No more serials come from {source.name}, which was closed: {rest}.{self._too_few}"
        self._note("unit.closed", text, None, Severity.WARNING)
        self._give_up()

    def _lose(self, source: LineSource, why: str) -> None:
        text = (
            f"No more serials can be read from {source.name}: {why}. The joints that follow belong"
            f" to no known unit.{self._too_few}"
        )
        self._note("unit.lost", text, None, Severity.WARNING)
        self._end_unit()
        self._give_up()

    @property
    def _too_few(self) -> str:
        return (
            ""
            if self._wanted is None or self.is_done
            else " The wanted number of units can no longer be reached."
        )

    def _give_up(self) -> None:
        if self._source is not None:
            self._source.close()
            self._source = None

    def _note(
        self,
        kind: str,
        text: str,
        raw: str | None,
        severity: Severity = Severity.INFO,
        value: float | None = None,
    ) -> None:
        earliest = self._looked if self._looked < self._now else None
        self._keep(
            EventRow(self._now, kind, severity, text, earliest=earliest, value=value, raw=raw)
        )
