"""The record of a run on a noisy wire held against the wire's own books: nothing from nowhere,
nothing wrong but what was forged.

What an answer means is told here by hand, from the manuals. A reading is named by tick, port and
the first column that it fills.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from support.links.damage import jbc_holds, omega_holds
from support.links.noisy_wire import LONGEST_S, Exchange, NoisyWire
from support.product import COLUMN, SampleRow
from support.virtual.virtual_run import VirtualRun

Meaning = Callable[[str], object]
Reading = tuple[int, int, str]


def _digit(place: int, yes: str = "1") -> Meaning:
    return lambda data: data[place] == yes


def _word(place: int, *names: str) -> Meaning:
    return lambda data: dict(enumerate(names)).get(int(data[place]))


SOLDERING: dict[str, tuple[str, Meaning]] = {
    "temperature_c": ("TT{port}", int),
    "power_permille": ("PP{port}", int),
    "status": ("PS{port}", _word(4, "working", "stand", "sleep", "hibernation")),
    "cooling": ("PS{port}", _digit(3)),
    "desoldering": ("PS{port}", _digit(2)),
    "motor": ("PS{port}", _word(1, "off", "forward", "backward")),
    "setpoint_c": ("ST{port}", int),
    "tool": ("CT{port}", int),
    "port_error": ("PE{port}", int),
    "station_error": ("SER", int),
    # any other digit is set (docs/reference/contradictions.md, B-24)
    "alarm_high": ("TA{port}", lambda data: data[4] != "0"),
    "alarm_low": ("TA{port}", lambda data: data[3] != "0"),
    "transformer_c": ("TT", int),
    "transistor_c": ("QT{port}", int),
    "delay_s": ("ED{port}", int),
    "feeding": ("FEE", _digit(4)),
}
AIR = SOLDERING | {
    "temperature_c": ("AT{port}", int),
    "external_c": ("ET{port}", int),
    "set_flow_permille": ("SF{port}", int),  # of virtual stations, whose R-MAF is 1000
    "status": ("PS{port}", _word(4, "off", "on")),
}
OMEGA: dict[str, tuple[str, Meaning]] = {
    "solder_shortage": ("A", lambda data: data in "13"),
    "clogged": ("A", lambda data: data in "23"),
    "preparing": ("B", lambda data: data == "1"),
    "in_range": ("F", lambda data: data == "0"),
}
PROBE = "SER"  # of what stands in a row, what a client asks for no row's sake; on OMEGA everything
SHARED = {
    "cooling": "status",
    "desoldering": "status",
    "motor": "status",
    "alarm_low": "alarm_high",
    "clogged": "solder_shortage",
}


def meanings(family: str) -> Mapping[str, tuple[str, Meaning]]:
    return {"jtse": AIR, "omega": OMEGA}.get(family, SOLDERING)


@dataclass
class Verdict:
    """What a run's rows show. `recorded` are wrong values that the wire forged; `set_aside`
    forgeries that came and are in no row as values; `lies` all that must not be.
    """

    readings: int = 0
    recorded: set[Reading] = field(default_factory=set)
    due_to_be: set[Reading] = field(default_factory=set)  # recorded, by the wire's own count
    set_aside: int = 0
    lies: list[str] = field(default_factory=list)


def judge_rows(run: VirtualRun, wire: NoisyWire) -> Verdict:
    """Hold every row against the books."""
    return _Judge(run, wire).judged()


class _Judge:
    def __init__(self, run: VirtualRun, wire: NoisyWire) -> None:
        self.run, self.verdict = run, Verdict()
        self.is_omega = run.facts.family == "omega"
        self.addressed = next(iter(run.contexts.values())).order.address is not None
        self.meanings = meanings(run.facts.family)
        self.books = [one for one in wire.books if one.at]
        self.moments = [one.at for one in self.books]
        self.forged: dict[str, list[float]] = {}
        for forgery in wire.forgeries:
            self.forged.setdefault(forgery.text, []).append(forgery.at)

    def judged(self) -> Verdict:
        period_s = self.run.facts.period_s
        for row in self.run.memory.samples:
            late, scan = row[COLUMN["late_us"]], row[COLUMN["scan_us"]]
            if isinstance(late, int) and isinstance(scan, int) and period_s is not None:
                begin = self.run.t0 + int(str(row[COLUMN["tick"]])) * period_s + late / 1e6
                first, end = (
                    bisect_left(self.moments, begin - 1e-4),
                    bisect_right(self.moments, begin + scan / 1e6),
                )
                self._row(row, self.books[first:end])
        total = sum(len(moments) for moments in self.forged.values())
        self.verdict.set_aside = total - len(self.verdict.recorded)
        return self.verdict

    def _row(self, row: SampleRow, asked: Sequence[Exchange]) -> None:
        by_code: dict[str, list[Exchange]] = {}
        for one in asked:
            by_code.setdefault(one.text.rstrip(), []).append(one)
        for column, (code, meaning) in self.meanings.items():
            value = row[COLUMN[column]]
            if value is not None:
                code = code.format(port=row[COLUMN["port"]])
                self._value(
                    row,
                    column,
                    value,
                    by_code.get(code if self.is_omega else f"R{code}", []),
                    meaning,
                    code,
                )

    def _value(
        self,
        row: SampleRow,
        column: str,
        value: object,
        asked: Sequence[Exchange],
        meaning: Meaning,
        code: str,
    ) -> None:
        self.verdict.readings += 1
        if (
            len(asked) == 1
            and asked[0].is_plain
            and meaning(str(self._data(str(asked[0].truth), code))) == value
        ):
            return
        truths = {text for one in asked for text in (one.truth, *one.beside) if text}
        means = {meaning(data) for text in truths if (data := self._data(text, code)) is not None}
        words = [
            words
            for one in asked
            if (
                words := [word for word in self._answers(one, code) if meaning(word[0]) is not None]
            )
        ]
        place = (
            int(str(row[COLUMN["tick"]])),
            int(str(row[COLUMN["port"]])),
            SHARED.get(column, column),
        )
        told = [word for found in words for word in found if meaning(word[0]) == value]
        if value not in means:
            self.verdict.recorded.add(place)
        if not told:
            self._lies(place, f"{column} = {value!r} was not even told; the station said {truths}")
        elif value not in means and not any(self._is_forged(data, code, now) for data, now in told):
            self._lies(
                place, f"{column} = {value!r}, the station said {truths}, and nothing was forged"
            )
        # asked later, to see whether anybody is there
        is_probe = (self.is_omega or code == PROBE) and value in means
        # the first answer to the last question
        if words and meaning(words[-1][0][0]) not in means and not is_probe:
            self.verdict.due_to_be.add(place)

    def _lies(self, place: Reading, text: str) -> None:
        self.verdict.lies.append(f"tick {place[0]}, port {place[1]}: {text}")

    def _answers(self, one: Exchange, code: str) -> Iterator[tuple[str, float]]:
        """The data of every whole answer to this question in what came, with the moment."""
        stream, now = (
            b"".join(data for _, data in one.given),
            (one.given[-1][0] if one.given else 0.0),
        )
        for match in _frames(code, self.is_omega, self.addressed).finditer(stream):
            frame = match[1]
            if omega_holds(frame) if self.is_omega else jbc_holds(frame):
                yield match[2].decode("ascii"), now

    def _data(self, text: str, code: str) -> str | None:
        head = code.lower() if self.is_omega else f"A{code}"
        return text[len(head) :] if text.startswith(head) else None

    def _is_forged(self, data: str, code: str, now: float) -> bool:
        text = (code.lower() if self.is_omega else f"A{code}") + data
        return any(
            at <= now + 1e-6 and now - at < LONGEST_S + 5 for at in self.forged.get(text, ())
        )


@lru_cache(512)
def _frames(code: str, is_omega: bool, addressed: bool) -> re.Pattern[bytes]:
    """A whole answer, wherever it begins: its addresses in either order, if there are any, its
    code, five digits.
    """
    if is_omega:
        return re.compile(rb"(?=(\x02%s(\d)\x03..))" % code.lower().encode(), re.DOTALL)
    addresses = b"(?:0100|0001)" if addressed else b""
    return re.compile(rb"(?=(\x02%sA%s([0-9]{5})\x03.))" % (addresses, code.encode()), re.DOTALL)
