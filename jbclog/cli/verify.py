"""`jbclog verify`: a tip against an external thermometer."""

from __future__ import annotations

from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import StartRefused, UsageError

if TYPE_CHECKING:
    from jbclog.maintenance.verification import Own, Verification
    from jbclog.session.manual.contact import Target

DISPLAY_C = (0.0, 600.0)


@ends_with_errors_told
def verify(
    station: str = options.STATION_NAMED,
    line: Path = options.LINE,
    port: int = typer.Option(..., "--port", "-p", min=1, max=4, metavar="N", help="Which port.", show_default=False),
    reading: float = typer.Option(..., metavar="C", help="What the thermometer shows, in °C.", show_default=False),
    instrument: str = typer.Option(..., metavar="ID", help="Which thermometer.", show_default=False),
    due: str = typer.Option(..., metavar="DATE", help="Until when its calibration holds: 2027-03-01.", show_default=False),
    tip: str = typer.Option(..., metavar="ID", help="Which tip.", show_default=False),
    by: str = typer.Option(..., metavar="WHO", help="Who measured.", show_default=False),
    station_c: float | None = typer.Option(
        None, "--station-c", metavar="C", help="What the station's display shows; it is not asked then.", show_default=False
    ),
    limit: float = typer.Option(15.0, metavar="C", help="How far apart, either way, is allowed."),
    instrument_u: float | None = typer.Option(
        None, "--instrument-u", metavar="C", help="The thermometer's uncertainty (k = 2), off its certificate.", show_default=False
    ),
    remark: str = typer.Option("", "--note", metavar="TEXT", help="Anything to be kept beside it."),
    out: Path = typer.Option(Path("runs"), "--out", "-o", metavar="DIR", help="The folder of runs, in which it is kept."),
    as_json: bool = options.AS_JSON,
) -> None:
    """Record a tip verification against an external thermometer.

    Hold the thermometer to the tip while this reads the station's own temperature, twelve times in six seconds; a tip that does
    not work, or moves by more than 3 °C, is refused. PASS where reading and station, and reading and setting, are within
    --limit; an instrument past its due date makes it INVALID. It is put at the end of verifications.jsonl in --out; each run
    cites the last valid one. Where an adjustment would help, the call that writes it is printed; nothing is ever written.
    Ends with 1 where it did not pass.

    \b
    Example:
      jbclog verify dde-1 -l line.toml -p 1 --reading 352.4 --instrument TC-7 --due 2027-03-01 --tip T-17 --by "A. Rossi"
    """
    from jbclog.app.connection import target_in
    from jbclog.maintenance.verification import Given, Own, keep
    from jbclog.maintenance.verification import verify as verified

    _check({"--instrument": instrument, "--tip": tip, "--by": by}, remark)
    target = target_in(line, station)
    expires = _date(due)
    given = Given(station, port, reading, instrument, expires, tip, by, limit, instrument_u, remark)
    verified(given, Own(reading), _now())  # what cannot be is said before the station is asked
    own = _asked(target, port) if station_c is None else _typed(station_c)
    kept, head = keep(out, verified(given, own, _now()))
    _tell(kept, head, target, line, out, as_json=as_json)
    if kept.result != "pass":
        raise typer.Exit(1)


def _now() -> datetime:
    from jbclog.app import connection

    return datetime.fromtimestamp(connection.means.clock.utc(), UTC)


def _check(texts: dict[str, str], remark: str) -> None:
    for option, text in texts.items():
        if not text.strip():
            raise UsageError(f"verify: {option} is needed")
        options.check_text(option, text)
    options.check_text("--note", remark)


def _date(text: str) -> date:
    try:
        return date.fromisoformat(text.strip())
    except ValueError:
        raise UsageError(f"--due {text}: give the day until which its calibration holds, such as 2027-03-01") from None


def _typed(celsius: float) -> Own:
    from jbclog.maintenance.verification import Own

    if not DISPLAY_C[0] <= celsius <= DISPLAY_C[1]:
        raise UsageError(f"{celsius:g} °C: a station shows {DISPLAY_C[0]:g} to {DISPLAY_C[1]:g} °C")
    return Own(celsius)


def _asked(target: Target, port: int) -> Own:
    """Read-only: nothing but questions can go out."""
    from jbclog.app.connection import ask
    from jbclog.maintenance.verification import own_of, unstable
    from jbclog.session.manual.read import read_tip

    found = ask(target, read_tip(target, port))
    why = unstable(found.temperatures, found.states, found.settings)
    if why is not None:
        raise StartRefused(f"{target.name} port {port}: {why}; nothing was kept. Wait until it idles at its setting, and repeat")
    setting = found.settings[-1] if found.settings else None
    return own_of(found.temperatures, setting, found.adjust_c, found.tool, found.model)


def _tell(kept: Verification, head: str, target: Target, line: Path, out: Path, *, as_json: bool) -> None:
    from dataclasses import asdict

    from jbclog.record.chains import short_head

    call = _proposal(kept, target, line)
    if as_json:
        tell_json({**asdict(kept), "head": head, "file": str(out / "verifications.jsonl"), "proposed_call": call})
        return
    read = f"mean of {kept.station_n} readings, sd {kept.station_sd_c:.2f} °C" if kept.station_n else "read off its display"
    tell(f"{kept.result.upper()}  {kept.station} port {kept.port}, tip {kept.tip}: {kept.text}")
    tell(f"  thermometer {kept.reading_c:.1f} °C ({kept.instrument}, due {kept.due}); station {kept.station_c:.1f} °C ({read})")
    tell(f"  offset {kept.offset_c:+.1f} °C ± {kept.uncertainty_c:.1f} °C (k = 2; {_what_is_in(kept)})")
    tell(f"  kept as number {kept.seq} in {out / 'verifications.jsonl'} (head {short_head(head)})")
    for text in _advice(kept, call):
        note(text)


def _what_is_in(kept: Verification) -> str:
    return "the instrument's is in it" if kept.instrument_u_c else "without the instrument's, which was not stated (--instrument-u)"


def _proposal(kept: Verification, target: Target, line: Path) -> str | None:
    """The call that would write it, as it can be typed."""
    from jbclog.cli.values import call
    from jbclog.session.manual.contact import Place
    from jbclog.session.manual.write import WriteRequest

    if kept.proposed_adjust_c is None:
        return None
    return call("write", target, WriteRequest("adjust", str(kept.proposed_adjust_c), Place(kept.port)), line)


def _advice(kept: Verification, call: str | None) -> list[str]:
    from jbclog.maintenance.verification.verification import MOST_ADJUST_C, needed_adjust_c

    found = []
    needed = needed_adjust_c(kept)
    if call is not None:
        found.append(f"proposed, not written: {call}   (now {kept.adjust_c:g} °C; then verify again)")
    elif needed is not None and abs(needed) > MOST_ADJUST_C and kept.result != "invalid":
        found.append(f"an adjustment of {needed} °C is beyond ±{MOST_ADJUST_C} °C: change the tip, or have the station looked at")
    if kept.result == "fail":
        found.append(f"the runs since the last good one: jbclog where-used --station {kept.station} --port {kept.port}")
    return found
