"""OMEGA's solder condition: read, compare field by field, write if allowed, read back.

A condition that the controller has already is not written. Another one is written only with
`--allow-omega-write`, once, because it decides the machine's next action; otherwise the run is
refused with the differences. The controller ignores what it refuses, and its ``d`` can be lost, so
only reading back decides.
"""

from __future__ import annotations

from jbclog.config.recipe_settings import condition_of
from jbclog.core.errors import Ignored, LinkError, NotSupported, StartRefused, StationError
from jbclog.core.io_requests import RunEnded
from jbclog.core.rows import SettingOutcome, SettingRow, Severity
from jbclog.protocol.commands.omega import (
    ConditionRecord,
    SetTemperature,
    StoredRecord,
    difference,
    differing,
)
from jbclog.session.run.context import SessionContext
from jbclog.session.run.watch import report_change

BAD = (SettingOutcome.MISMATCH, SettingOutcome.REFUSED)


async def look_at_condition(context: SessionContext) -> ConditionRecord | None:
    """Read and compare the recipe's condition; return the one to write. Raises `StartRefused` if it
    must not be written.
    """
    wanted = condition_of(context.order.recipe, context.state.family)
    if wanted is None:
        return None
    held = await _held(context, wanted)
    if held == wanted:
        _rows(context, wanted, held, SettingOutcome.UNCHANGED)
        return None
    if not context.order.allow_omega_write:
        _rows(context, wanted, held, SettingOutcome.MISMATCH)
        raise StartRefused(
            f"{context.name}: condition {wanted.condition} is not what the recipe asks:"
            f" {difference(wanted, held)}. Nothing was written; run with --allow-omega-write to"
            " have it written"
        )
    return wanted


async def bring_condition(context: SessionContext, wanted: ConditionRecord | None) -> None:
    """Write the condition that `look_at_condition` returned. Raises `StartRefused` if it is not
    confirmed.
    """
    if wanted is not None:
        held = context.state.held["condition"]
        assert isinstance(held, StoredRecord)
        await _write(context, wanted, held)


async def check_condition(context: SessionContext) -> None:
    """Read the condition again at the end; report a change."""
    before = context.state.held.get("condition")
    if not isinstance(before, StoredRecord):
        return
    try:
        found = await _read(context, before.condition)
    except StationError as error:
        text = (
            f"Condition {before.condition} could not be read at the end: {error}. The settings have"
            " it as it was at the start."
        )
        context.log.note("setting.unread", Severity.WARNING, text)
        return
    if found != before:
        context.state.held["condition"] = found
        was, now = (
            ", ".join(f"{one[0]} {one[place]}" for one in differing(before, found))
            for place in (1, 2)
        )
        report_change(context, None, f"condition_{before.condition}", was, now)


async def _read(context: SessionContext, number: int) -> StoredRecord:
    found = await context.reads.confirmed(context.command("condition").numbered(number))
    assert isinstance(found, StoredRecord)
    return found


async def _held(context: SessionContext, wanted: ConditionRecord) -> StoredRecord:
    """Return the controller's record under the recipe's number, before anything is written."""
    try:
        held = await _read(context, wanted.condition)
    except NotSupported as error:
        _rows(context, wanted, None, SettingOutcome.REFUSED)
        raise StartRefused(
            f"{context.name}: it does not know condition {wanted.condition}: {error}"
        ) from error
    except StationError as error:
        raise StartRefused(
            f"{context.name}: cannot read condition {wanted.condition}: {error}"
        ) from error
    if isinstance(held, SetTemperature):
        _note_unknown_scale(context, held)
    context.state.held["condition"] = held
    return held


def _note_unknown_scale(context: SessionContext, held: SetTemperature) -> None:
    """Report a temperature of unknown scale (docs/reference/contradictions.md, B-51)."""
    raw = held.set_temperature_raw
    place = (
        f"condition {held.condition}: {raw} on the wire, {raw / 10:.1f} °C if it is in tenths and"
        f" {raw} °C if it is not"
    )
    context.station.anomalies.meet(51, place, context.station.data)


async def _write(context: SessionContext, wanted: ConditionRecord, held: StoredRecord) -> None:
    """Write once, read back, compare. After an exception the write may or may not have been
    executed.
    """
    try:
        ignored = await _write_once(context, wanted)
        found = await _read(context, wanted.condition)
    except (LinkError, RunEnded, StationError) as error:
        _rows(context, wanted, None, SettingOutcome.UNCONFIRMED, written=True)
        if not isinstance(error, StationError):
            raise
        raise StartRefused(
            f"{_asked(context, wanted)}, it could not be read back ({error}); before it was {held}"
        ) from error
    context.state.held["condition"] = found
    if found == wanted:
        _rows(context, wanted, found, SettingOutcome.CONFIRMED, written=True)
        return
    _rows(
        context,
        wanted,
        found,
        SettingOutcome.REFUSED if ignored else SettingOutcome.MISMATCH,
        written=True,
    )
    why = "the controller ignored it" if ignored else "it was acknowledged"
    raise StartRefused(
        f"{_asked(context, wanted)}, {why}, and read back it has {difference(wanted, found)};"
        f" before it was {held}"
    )


async def _write_once(context: SessionContext, wanted: ConditionRecord) -> bool:
    """Write; return True if it was ignored. The read-back decides even after a lost
    acknowledgement.
    """
    try:
        await context.station.write(context.command("store_condition"), wanted)
    except Ignored:
        return True
    except StationError:
        pass
    return False


def _asked(context: SessionContext, wanted: ConditionRecord) -> str:
    return f"{context.name}: condition {wanted.condition} was written"


def _rows(
    context: SessionContext,
    wanted: ConditionRecord,
    found: StoredRecord | None,
    outcome: SettingOutcome,
    *,
    written: bool = False,
) -> None:
    """Record a row for each field; after a bad outcome, fields with the right value are
    unchanged.
    """
    held = {} if found is None else {name: text for name, _, text in found.values()}
    for name, unit, text in wanted.values():
        readback = held.get(name)
        row = SettingRow(
            time=context.log.utc.micros(context.now),
            station=context.name,
            port=None,
            tool_name=None,
            setting=f"condition_{wanted.condition}.{name}",
            uom=unit,
            requested=text,
            written=text if written else None,
            readback=readback,
            nak=None,
            outcome=SettingOutcome.UNCHANGED if readback == text and outcome in BAD else outcome,
        )
        context.log.journal.setting(row)
