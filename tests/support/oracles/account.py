"""The record of a virtual run held against what the wire carried, without any of the code that
keeps accounts.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from support.product import COLUMN, SIGNAL_COLUMNS, SIGNAL_OF_COLUMN, SampleRow
from support.virtual.virtual_run import Heard, VirtualRun

CODES = {
    "temperature_c": "TT{port}",
    "power_permille": "PP{port}",
    "status": "PS{port}",
    "setpoint_c": "ST{port}",
    "tool": "CT{port}",
    "port_error": "PE{port}",
    "transistor_c": "QT{port}",
    "alarm_high": "TA{port}",
    "station_error": "SER",
    "transformer_c": "TT",
}
AIR_CODES = {
    "temperature_c": "AT{port}",
    "external_c": "ET{port}",
    "power_permille": "PP{port}",
    "status": "PS{port}",
    "setpoint_c": "ST{port}",
    "set_flow_permille": "SF{port}",
    "tool": "CT{port}",
    "port_error": "PE{port}",
    "station_error": "SER",
}
STATUS = {"0": "working", "1": "stand", "2": "sleep", "3": "hibernation"}
AIR_STATUS = {"0": "off", "1": "on"}


def reasons_in(row: SampleRow) -> dict[str, str]:
    """The columns that the row says are missing, with the reason."""
    text = row[COLUMN["reasons"]]
    return dict(item.split("=") for item in str(text).split(";")) if text else {}


def reasons_of(run: VirtualRun, column: str) -> list[str]:
    """Why the column has no value, for each row that says so."""
    return [reasons[column] for reasons in map(reasons_in, run.memory.samples) if column in reasons]


def counted(run: VirtualRun) -> dict[tuple[str, str], Counter[str]]:
    """For each port and signal: how often it came (``ok``), and how often each reason stands in its
    place.
    """
    found: dict[tuple[str, str], Counter[str]] = {}
    for row in run.memory.samples:
        port, reasons = str(row[COLUMN["port"]]), reasons_in(row)
        for column in SIGNAL_COLUMNS:
            if SIGNAL_OF_COLUMN[column] != column:
                continue
            assert row[COLUMN[column]] is None or column not in reasons, (
                f"{column} has a value and a reason"
            )
            if row[COLUMN[column]] is not None:
                found.setdefault((port, column), Counter())["ok"] += 1
            elif column in reasons:
                found.setdefault((port, column), Counter())[reasons[column]] += 1
    for one in run.memory.counters:
        reason = "ok" if one.value is not None else one.raw.strip("<>")
        found.setdefault((str(one.port), one.counter), Counter())[reason] += 1
    return found


def assert_account_holds(run: VirtualRun) -> None:
    """Every due reading is a value or a reason, as many as the session itself counted; every tick
    has its rows.
    """
    facts, rows = run.facts, counted(run)
    for port, signals in facts.due.items():
        for signal, due in signals.items():
            if signal in facts.watched.get(port, {}):
                watched = dict(facts.watched[port][signal])
                assert watched.pop("due") == due == sum(watched.values()), signal
            else:
                assert sum(rows.get((port, signal), Counter()).values()) == due, (
                    f"{signal} of port {port}"
                )
    context = next(iter(run.contexts.values()))
    for port in facts.ports:
        count = rows.get((str(port), "temperature_c"), Counter())
        if count:
            assert context.count_readings(port) == (
                sum(count.values()) + facts.skipped,
                count["ok"],
            ), "coverage as shown"
        ticks = run.memory.column("tick", port)
        assert ticks == sorted(set(ticks)), "a tick twice, or out of order"
        if facts.first_tick is not None and facts.last_tick is not None:
            assert len(ticks) + facts.skipped == facts.last_tick - facts.first_tick + 1


def wrong_values(run: VirtualRun, *, as_sent: bool = False) -> list[str]:
    """Every recorded value that is not what the station had to say to a question asked for that
    row.

    `as_sent`: or what a fault made of that, where flipped bits can look like a good answer.
    """
    facts = run.facts
    if facts.period_s is None:
        return []
    return wrong_rows(
        run.memory.samples,
        run.heard,
        run.t0,
        facts.period_s,
        as_sent=as_sent,
        is_air=facts.family == "jtse",
    )


def wrong_rows(
    rows: Iterable[SampleRow],
    heard: Sequence[Heard],
    t0: float,
    period_s: float,
    *,
    as_sent: bool = False,
    is_air: bool = False,
) -> list[str]:
    """The same of rows of one station, sampled each `period_s` from `t0` on (monotonic seconds);
    `heard` in the order of time.
    """
    found: list[str] = []
    moments = [one.at for one in heard]
    for row in rows:
        late, scan = row[COLUMN["late_us"]], row[COLUMN["scan_us"]]
        if not isinstance(late, int) or not isinstance(scan, int):
            continue
        begin = t0 + int(str(row[COLUMN["tick"]])) * period_s + late / 1e6
        first, end = bisect_left(moments, begin - 1e-4), bisect_right(moments, begin + scan / 1e6)
        found += _wrong_in(row, heard[first:end], as_sent, is_air)
    return found


def _wrong_in(row: SampleRow, asked: Sequence[Heard], as_sent: bool, is_air: bool) -> Iterator[str]:
    for column, code in (AIR_CODES if is_air else CODES).items():
        value, wanted = row[COLUMN[column]], code.format(port=row[COLUMN["port"]])
        if value is None:
            continue
        told = [
            text
            for one in asked
            if one.text == f"R{wanted}"
            for text in ([one.clean, one.sent] if as_sent else [one.clean])
        ]
        said = [
            text
            for text in told
            if text is not None
            and text.startswith(f"A{wanted}")
            and text[1 + len(wanted) :].isdigit()
        ]
        if value not in [_read(column, text[1 + len(wanted) :], is_air) for text in said]:
            yield (
                f"tick {row[COLUMN['tick']]} port {row[COLUMN['port']]}: {column} = {value!r}, the"
                f" station said {said}"
            )


def _read(column: str, data: str, is_air: bool) -> object:
    """What a data field means; the flow of virtual stations is in per mille as it is, their R-MAF
    being 1000.
    """
    if column == "status":
        return (AIR_STATUS if is_air else STATUS).get(data[4])
    return data[4] == "1" if column == "alarm_high" else int(data)
