"""`jbclog verify`: verify a tip against an external thermometer."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.core.errors import StartRefused, UsageError

if TYPE_CHECKING:
    from jbclog.app.port_access import PortAccess
    from jbclog.maintenance.verification import Own, Verification
    from jbclog.session.manual.contact import Target

DISPLAY_C = (0.0, 600.0)


@reports_errors
def verify(
    ctx: typer.Context,
    station: str = options.STATION_NAMED,
    line: Path = options.LINE,
    port: int = typer.Option(
        ..., "--port", "-p", min=1, max=4, metavar="N", help="Port number.", show_default=False
    ),
    reading: float = typer.Option(
        ..., metavar="C", help="Thermometer reading, °C.", show_default=False
    ),
    instrument: str = typer.Option(..., metavar="ID", help="Thermometer.", show_default=False),
    due: str = typer.Option(
        ..., metavar="DATE", help="Calibration due date: 2027-03-01.", show_default=False
    ),
    tip: str = typer.Option(..., metavar="ID", help="Tip.", show_default=False),
    by: str = typer.Option(..., metavar="WHO", help="Person.", show_default=False),
    station_c: float | None = typer.Option(
        None,
        "--station-c",
        metavar="C",
        help="Reading of the station's display, °C; sends no query.",
        show_default=False,
    ),
    limit: float = typer.Option(15.0, metavar="C", help="Permitted deviation, ± °C."),
    instrument_u: float | None = typer.Option(
        None,
        "--instrument-u",
        metavar="C",
        help="Expanded uncertainty of the thermometer (k = 2), °C.",
        show_default=False,
    ),
    remark: str = options.REMARK,
    out: Path = options.OUT,
    as_json: bool = options.AS_JSON,
) -> None:
    """Record a tip verification against an external thermometer.

    Hold the thermometer to the tip while this reads the station's temperature twelve times in six
    seconds. Refuses a tip that is not in work or changes by more than 3 °C. PASS: the reading is
    within --limit of the station's reading and of the setpoint;
    INVALID: the thermometer is past its due date. Appends the result to verifications.jsonl in
    --out; each run cites the last valid one. Prints the command for an adjustment that would help,
    and writes nothing to the station. Exit code 1: not passed.

    \b
    Example:
      jbclog verify dde-1 -l line.toml -p 1 --reading 352.4 --instrument TC-7 --due 2027-03-01 --tip T-17 --by "A. Rossi"
    """  # noqa: E501  # a command is copied as one line
    from jbclog.app.connection import target_in
    from jbclog.maintenance.verification import Given, Own, keep
    from jbclog.maintenance.verification import verify as verified

    _check({"--instrument": instrument, "--tip": tip, "--by": by}, remark)
    target = target_in(line, station)
    expires = _date(due)
    given = Given(station, port, reading, instrument, expires, tip, by, limit, instrument_u, remark)
    access = options.port_access(ctx)
    verified(given, Own(reading), access.now())  # reject impossible values before anything is sent
    own = _read_own(target, port, access) if station_c is None else _typed(station_c)
    kept, head = keep(out, verified(given, own, access.now()))
    _print(kept, head, target, line, out, as_json=as_json)
    if kept.result != "pass":
        raise typer.Exit(1)


def _check(texts: dict[str, str], remark: str) -> None:
    for option, text in texts.items():
        if not text.strip():
            raise UsageError(f"verify: {option} is required")
        options.check_text(option, text)
    options.check_text("--note", remark)


def _date(text: str) -> date:
    try:
        return date.fromisoformat(text.strip())
    except ValueError:
        raise UsageError(f"--due {text}: must be a date such as 2027-03-01") from None


def _typed(celsius: float) -> Own:
    from jbclog.maintenance.verification import Own

    if not DISPLAY_C[0] <= celsius <= DISPLAY_C[1]:
        raise UsageError(f"--station-c {celsius:g}: must be {DISPLAY_C[0]:g}–{DISPLAY_C[1]:g} °C")
    return Own(celsius)


def _read_own(target: Target, port: int, access: PortAccess) -> Own:
    """Read the station's own temperature, by queries only."""
    from jbclog.app.connection import ask
    from jbclog.maintenance.verification import own_of, unstable
    from jbclog.session.manual.read import read_tip

    found = ask(target, read_tip(target, port), access)
    why = unstable(found.temperatures, found.states, found.settings)
    if why is not None:
        raise StartRefused(
            f"{target.name} port {port}: {why}; not recorded. Repeat when the tip is stable at its"
            " setpoint"
        )
    setting = found.settings[-1] if found.settings else None
    return own_of(found.temperatures, setting, found.adjust_c, found.tool_name, found.model)


def _print(
    kept: Verification, head: str, target: Target, line: Path, out: Path, *, as_json: bool
) -> None:
    from dataclasses import asdict

    from jbclog.record.chains import short_head

    call = _proposal(kept, target, line)
    if as_json:
        echo_json(
            {
                **asdict(kept),
                "head": head,
                "file": str(out / "verifications.jsonl"),
                "proposed_call": call,
            }
        )
        return
    read = (
        f"mean of {kept.station_n} readings, sd {kept.station_sd_c:.2f} °C"
        if kept.station_n
        else "from its display"
    )
    echo(f"{kept.result.upper()}  {kept.station} port {kept.port}, tip {kept.tip}: {kept.text}")
    echo(
        f"  thermometer {kept.reading_c:.1f} °C ({kept.instrument}, due {kept.due}); station"
        f" {kept.station_c:.1f} °C ({read})"
    )
    echo(
        f"  offset {kept.offset_c:+.1f} °C ± {kept.uncertainty_c:.1f} °C (k = 2;"
        f" {_what_is_in(kept)})"
    )
    echo(
        f"  recorded as number {kept.seq} in {out / 'verifications.jsonl'} (fingerprint"
        f" {short_head(head)})"
    )
    note(*_advice(kept, call))


def _what_is_in(kept: Verification) -> str:
    return (
        "including the thermometer"
        if kept.instrument_u_c
        else "without the thermometer: give --instrument-u"
    )


def _proposal(kept: Verification, target: Target, line: Path) -> str | None:
    """Return the command that writes the proposed adjustment."""
    from jbclog.cli.values import call
    from jbclog.session.manual.write import WriteRequest
    from jbclog.session.setting_write import Place

    if kept.proposed_adjust_c is None:
        return None
    return call(
        "write", target, WriteRequest("adjust", str(kept.proposed_adjust_c), Place(kept.port)), line
    )


def _advice(kept: Verification, call: str | None) -> list[str]:
    from jbclog.maintenance.verification import MOST_ADJUST_C, needed_adjust_c

    found = []
    needed = needed_adjust_c(kept)
    if call is not None:
        found.append(
            f"proposed, not written: {call}   (now {kept.adjust_c:g} °C; verify again afterwards)"
        )
    elif needed is not None and abs(needed) > MOST_ADJUST_C and kept.result != "invalid":
        found.append(
            f"required adjustment {needed} °C, limit ±{MOST_ADJUST_C} °C: change the tip or service"
            " the station"
        )
    if kept.result == "fail":
        found.append(
            f"list the runs since the last pass: jbclog where-used --station {kept.station} --port"
            f" {kept.port}"
        )
    return found
