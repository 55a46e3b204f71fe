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
from jbclog.protocol.commands.omega import ConditionRecord, SetTemperature, StoredRecord, difference, differing
from jbclog.session.run.context import SessionContext
from jbclog.session.run.watch import tell_change


def look_at_condition(context: SessionContext) -> Steps[ConditionRecord | None]:
    """Read and compare the recipe's condition; give what is to be written. Raises `StartRefused` where it must not be."""
    wanted = condition_of(context.recipe, context.family)
    if wanted is None:
        return None
    held = yield from _held(context, wanted)
    if held == wanted:
        _rows(context, wanted, held, "unchanged")
        return None
    if not context.order.allow_omega_write:
        _rows(context, wanted, held, "mismatch")
        raise StartRefused(
            f"{context.name}: condition {wanted.condition} is not what the recipe asks: {difference(wanted, held)}. "
            "Nothing was written; run with --allow-omega-write to have it written"
        )
    return wanted


def bring_condition(context: SessionContext, wanted: ConditionRecord | None) -> Steps[None]:
    """Write the condition that `look_at_condition` gave. Raises `StartRefused` where it does not hold then."""
    if wanted is not None:
        held = context.held["condition"]
        assert isinstance(held, StoredRecord)
        yield from _write(context, wanted, held)


def check_condition(context: SessionContext) -> Steps[None]:
    """Read the condition once more at the end; say where somebody changed it meanwhile."""
    before = context.held.get("condition")
    if not isinstance(before, StoredRecord):
        return
    try:
        found = yield from _read(context, before.condition)
    except StationError as error:
        text = f"Condition {before.condition} could not be read at the end: {error}. The settings have it as it was at the start."
        context.note("setting.unread", Severity.WARNING, text)
        return
    if found != before:
        context.held["condition"] = found
        was, now = (", ".join(f"{one[0]} {one[place]}" for one in differing(before, found)) for place in (1, 2))
        tell_change(context, None, f"condition_{before.condition}", was, now)


def _read(context: SessionContext, number: int) -> Steps[StoredRecord]:
    found = yield from context.read_confirmed(context.command("condition").numbered(number))
    assert isinstance(found, StoredRecord)
    return found


def _held(context: SessionContext, wanted: ConditionRecord) -> Steps[StoredRecord]:
    """What the controller holds under the recipe's number, before anything is written."""
    try:
        held = yield from _read(context, wanted.condition)
    except NotSupported as error:
        _rows(context, wanted, None, "refused")
        raise StartRefused(f"{context.name}: it does not know condition {wanted.condition}: {error}") from error
    except StationError as error:
        raise StartRefused(f"{context.name}: cannot read condition {wanted.condition}: {error}") from error
    if isinstance(held, SetTemperature):
        _tell_unresolved(context, held)
    context.held["condition"] = held
    return held


def _tell_unresolved(context: SessionContext, held: SetTemperature) -> None:
    """A temperature whose scale nothing here decides (docs/reference/contradictions.md, B-51)."""
    raw = held.set_temperature_raw
    place = f"condition {held.condition}: {raw} on the wire, {raw / 10:.1f} °C if it is in tenths and {raw} °C if it is not"
    context.station.anomalies.meet(51, place, context.station.data)


def _write(context: SessionContext, wanted: ConditionRecord, held: StoredRecord) -> Steps[None]:
    """Write once, read back, compare. What is broken off in between may or may not have been done."""
    try:
        ignored = yield from _write_once(context, wanted)
        found = yield from _read(context, wanted.condition)
    except (LinkError, RunEnded, StationError) as error:
        _rows(context, wanted, None, "unconfirmed", written=True)
        if not isinstance(error, StationError):
            raise
        raise StartRefused(f"{_asked(context, wanted)}, it could not be read back ({error}); before it was {held}") from error
    context.held["condition"] = found
    if found == wanted:
        _rows(context, wanted, found, "confirmed", written=True)
        return
    _rows(context, wanted, found, "refused" if ignored else "mismatch", written=True)
    why = "the controller ignored it" if ignored else "it was acknowledged"
    raise StartRefused(f"{_asked(context, wanted)}, {why}, and read back it has {difference(wanted, found)}; before it was {held}")


def _write_once(context: SessionContext, wanted: ConditionRecord) -> Steps[bool]:
    """Whether it was ignored. A lost acknowledgement is settled by the reading."""
    try:
        yield from context.station.write(context.command("store_condition"), wanted)
    except Ignored:
        return True
    except StationError:
        pass
    return False


def _asked(context: SessionContext, wanted: ConditionRecord) -> str:
    return f"{context.name}: condition {wanted.condition} was written"


def _rows(
    context: SessionContext, wanted: ConditionRecord, found: StoredRecord | None, outcome: str, *, written: bool = False
) -> None:
    """A row for each field; where the outcome is bad, fields that hold all the same are unchanged."""
    told = {} if found is None else {name: text for name, _, text in found.values()}
    for name, unit, text in wanted.values():
        readback = told.get(name)
        row = SettingRow(
            time=context.utc.micros(context.now),
            station=context.name,
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
        context.journal.setting(row)
