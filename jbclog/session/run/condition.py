"""OMEGA's solder condition: read, compared field by field, written where that is allowed, read back.

A recipe names one. Where the controller holds it already, nothing is written. Where it holds another, it is written only with
leave (`--allow-omega-write`), once, because it decides what the machine does next; without leave the run is refused with what
differs. The controller ignores what it does not take, and its ``d`` can be lost: only reading back says what it holds.
"""

from __future__ import annotations

from jbclog.config.recipe_settings import condition_of
from jbclog.core.errors import Ignored, LinkError, NotSupported, StartRefused, StationError
from jbclog.core.io_requests import RunEnded, Steps
from jbclog.core.rows import SettingRow, Severity
from jbclog.protocol.commands.omega_values import ConditionRecord, SetTemperature, Stored, difference, differing
from jbclog.session.run.context import SessionContext
from jbclog.session.run.watch import tell_change


def look_at_condition(desk: SessionContext) -> Steps[ConditionRecord | None]:
    """Read and compare the recipe's condition; give what is to be written. Raises `StartRefused` where it must not be."""
    wanted = condition_of(desk.recipe, desk.family)
    if wanted is None:
        return None
    held = yield from _held(desk, wanted)
    if held == wanted:
        _rows(desk, wanted, held, "unchanged")
        return None
    if not desk.order.allow_omega_write:
        _rows(desk, wanted, held, "mismatch")
        raise StartRefused(
            f"{desk.name}: condition {wanted.condition} is not what the recipe asks: {difference(wanted, held)}. "
            "Nothing was written; run with --allow-omega-write to have it written"
        )
    return wanted


def bring_condition(desk: SessionContext, wanted: ConditionRecord | None) -> Steps[None]:
    """Write the condition that `look_at_condition` gave. Raises `StartRefused` where it does not hold then."""
    if wanted is not None:
        held = desk.held["condition"]
        assert isinstance(held, Stored)
        yield from _write(desk, wanted, held)


def check_condition(desk: SessionContext) -> Steps[None]:
    """Read the condition once more at the end; say where somebody changed it meanwhile."""
    before = desk.held.get("condition")
    if not isinstance(before, Stored):
        return
    try:
        found = yield from _read(desk, before.condition)
    except StationError as error:
        text = f"Condition {before.condition} could not be read at the end: {error}. The settings have it as it was at the start."
        desk.note("setting.unread", Severity.WARNING, text)
        return
    if found != before:
        desk.held["condition"] = found
        was, now = (", ".join(f"{one[0]} {one[place]}" for one in differing(before, found)) for place in (1, 2))
        tell_change(desk, None, f"condition_{before.condition}", was, now)


def _read(desk: SessionContext, number: int) -> Steps[Stored]:
    found = yield from desk.agreed(desk.command("condition").numbered(number))
    assert isinstance(found, Stored)
    return found


def _held(desk: SessionContext, wanted: ConditionRecord) -> Steps[Stored]:
    """What the controller holds under the recipe's number, before anything is written."""
    try:
        held = yield from _read(desk, wanted.condition)
    except NotSupported as error:
        _rows(desk, wanted, None, "refused")
        raise StartRefused(f"{desk.name}: it does not know condition {wanted.condition}: {error}") from error
    except StationError as error:
        raise StartRefused(f"{desk.name}: cannot read condition {wanted.condition}: {error}") from error
    if isinstance(held, SetTemperature):
        _tell_unresolved(desk, held)
    desk.held["condition"] = held
    return held


def _tell_unresolved(desk: SessionContext, held: SetTemperature) -> None:
    """A temperature whose scale nothing here decides (digest B-51)."""
    raw = held.set_temperature_raw
    place = f"condition {held.condition}: {raw} on the wire, {raw / 10:.1f} °C if it is in tenths and {raw} °C if it is not"
    desk.station.anomalies.meet(51, place, desk.station.data)


def _write(desk: SessionContext, wanted: ConditionRecord, held: Stored) -> Steps[None]:
    """Write once, read back, compare. What is broken off in between may or may not have been done."""
    try:
        ignored = yield from _write_once(desk, wanted)
        found = yield from _read(desk, wanted.condition)
    except (LinkError, RunEnded, StationError) as error:
        _rows(desk, wanted, None, "unconfirmed", written=True)
        if not isinstance(error, StationError):
            raise
        raise StartRefused(f"{_asked(desk, wanted)}, it could not be read back ({error}); before it was {held}") from error
    desk.held["condition"] = found
    if found == wanted:
        _rows(desk, wanted, found, "confirmed", written=True)
        return
    _rows(desk, wanted, found, "refused" if ignored else "mismatch", written=True)
    why = "the controller ignored it" if ignored else "it was acknowledged"
    raise StartRefused(f"{_asked(desk, wanted)}, {why}, and read back it has {difference(wanted, found)}; before it was {held}")


def _write_once(desk: SessionContext, wanted: ConditionRecord) -> Steps[bool]:
    """Whether it was ignored. A lost acknowledgement is settled by the reading."""
    try:
        yield from desk.station.write(desk.command("store_condition"), wanted)
    except Ignored:
        return True
    except StationError:
        pass
    return False


def _asked(desk: SessionContext, wanted: ConditionRecord) -> str:
    return f"{desk.name}: condition {wanted.condition} was written"


def _rows(desk: SessionContext, wanted: ConditionRecord, found: Stored | None, outcome: str, *, written: bool = False) -> None:
    """A row for each field; where the outcome is bad, fields that hold all the same are unchanged."""
    told = {} if found is None else {name: text for name, _, text in found.values()}
    for name, unit, text in wanted.values():
        readback = told.get(name)
        row = SettingRow(
            time=desk.utc.micros(desk.now),
            station=desk.name,
            port=None,
            tool=None,
            setting=f"condition_{wanted.condition}.{name}",
            unit=unit,
            requested=text,
            written=text if written else None,
            readback=readback,
            nak=None,
            outcome="unchanged" if readback == text and outcome in ("mismatch", "refused") else outcome,
        )
        desk.journal.setting(row)
