"""`jbclog demo`: a whole run on virtual stations, through the real serial stack."""

from __future__ import annotations

import os
import tempfile
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import Color
from jbclog.cli.output import echo_json, echo_words, note, reports_errors, run_facts
from jbclog.cli.streams import never_wait
from jbclog.core.states import SafetyResult, StationOutcome

if TYPE_CHECKING:
    from jbclog.app.run.run_record import Result

LEAST_S = 14.0  # 7 s to heat up, 7 s for the faults
DROPPED, OVERHEATED = "dde-2", "ucr-1"
TIPS = ("dde-1:1=T-17", "dde-1:2=T-18", "dde-2:1=T-19", "dde-2:2=T-20", "ucr-1=T-21", "ale-1=T-22")
UNITS = ("SN-0101", "SN-0102")
NEXT_UNIT = 0.4  # of the recording time: all faults are in the second unit


@reports_errors
def demo(
    out: Path = typer.Option(
        Path("demo-runs"), "--out", "-o", metavar="DIR", help="Folder of runs."
    ),
    seconds: float = typer.Option(
        20.0, min=LEAST_S, max=3600.0, metavar="S", help="Recording time, in seconds."
    ),
    color: Color = options.COLOR,
    as_json: bool = options.AS_JSON,
) -> None:
    """Demonstrate a run on four virtual stations, recipe to report.

    Applies a recipe and records two units at 5 or 10 Hz through the real serial stack. One station
    raises an alarm, one disconnects and reconnects. The stations run in their own process, on
    pseudo-terminals (TCP without them), at real link speed.

    \b
    Example:
      jbclog demo --out demo-runs
    """
    from jbclog.report.write import write_report

    never_wait()
    result = _record(out, seconds, color, quiet=as_json)
    page = write_report(result.folder)
    shown = _shown(result)
    if as_json:
        echo_json(
            {
                **run_facts(result.folder),
                "report": str(page),
                "exit_code": result.exit_code.value,
                "shown": all(shown.values()),
            }
        )
    else:
        _print(result, page, shown)
    if not all(shown.values()):
        raise typer.Exit(1)


def _record(out: Path, seconds: float, color: Color, *, quiet: bool) -> Result:
    from jbclog.app.run.options import Metadata, RunOptions
    from jbclog.app.run.plan import make_plan
    from jbclog.app.run.runner import conduct
    from jbclog.cli.demo_units import BarcodeReader
    from jbclog.cli.progress import BackgroundObserver, observer
    from jbclog.sim.process import SimProcess

    metadata = Metadata(
        "demo",
        "DEMO-1",
        "demo board",
        tags={"note": "virtual stations"},
        tips=TIPS,
        reads_units=True,
    )
    with tempfile.TemporaryDirectory(prefix="jbclog-demo-") as folder:
        line, recipe = _files(Path(folder), seconds)
        tcp = None if hasattr(os, "openpty") else "127.0.0.1:0"
        if not quiet:
            note(
                "Demo on four virtual stations: dde-1 and dde-2 with two irons each, ucr-1 of a"
                " soldering robot, ale-1 with a solder feeder. No real station is used."
            )
        with SimProcess(line, Path(folder) / "ports", tcp=tcp) as stations:
            plan = make_plan(
                RunOptions(stations.line_path, recipe, duration_s=seconds, metadata=metadata)
            )
            reader = BarcodeReader(UNITS, seconds * NEXT_UNIT)
            shown = BackgroundObserver(observer(seconds, color, quiet=quiet, known=metadata))
            try:
                return conduct(plan, out, shown, missed=shown.missed, units=reader)
            finally:
                shown.close()


def _files(folder: Path, seconds: float) -> tuple[Path, Path]:
    """Write the demo's line file and recipe, with faults within `seconds`; return the paths."""
    source = files("jbclog.cli") / "demo_files"
    times = {"SECONDS_DROPOUT": seconds * 0.45, "SECONDS_OVERHEAT": seconds * 0.6}
    line = (source / "line.toml").read_text(encoding="utf-8")
    for word, moment in times.items():
        line = line.replace(word, f"{moment:.1f}")
    (folder / "line.toml").write_text(line, encoding="utf-8")
    (folder / "sn100c-demo.toml").write_text(
        (source / "recipe.toml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    return folder / "line.toml", folder / "sn100c-demo.toml"


def _shown(result: Result) -> dict[str, bool]:
    """Return each expected result and whether the record has it."""
    stations = {facts.name: facts for facts in result.manifest.stations}
    dropped, overheated = stations.get(DROPPED), stations.get(OVERHEATED)
    return {
        "every station was recorded until the end": all(
            facts.outcome == StationOutcome.COMPLETED for facts in stations.values()
        ),
        # more than once if the computer was busy and answers were late
        f"{DROPPED} lost its cable for 3 s and was recorded again after that": bool(
            dropped and dropped.outages
        ),
        f"{OVERHEATED} got too hot and raised its alarm": bool(overheated and overheated.alarms),
        "every tool is back in its stand, as the stations confirm": all(
            facts.safe_state and set(facts.safe_state.values()) == {SafetyResult.VERIFIED}
            for facts in stations.values()
        ),
    }


def _print(result: Result, page: Path, shown: dict[str, bool]) -> None:
    manifest = result.manifest
    rows = sum(file.rows or 0 for file in manifest.files if file.path.startswith("samples/"))
    echo_words("")
    echo_words(
        f"The recipe was set on {len(manifest.stations)} stations and read back; {rows} rows of"
        " readings were recorded."
    )
    for text, true in shown.items():
        echo_words(f"  {'yes' if true else 'NO '}  {text}")
    echo_words(f"Verdict by the limits in the recipe: {manifest.verdict}.")
    reasons = "; ".join(finding.text for finding in result.findings) or "no findings"
    echo_words(f"`jbclog run` would exit with code {result.exit_code.value}: {reasons}.")
    echo_words("")
    echo_words(f"report    {page}   (open in a browser)")
    echo_words(f"samples   {result.folder / 'samples'}   (open with pandas.read_parquet)")
    echo_words(f"events    {result.folder / 'events'}")
    echo_words(f"manifest  {result.folder / 'manifest.json'}")
    echo_words(f"run       {result.folder}")
