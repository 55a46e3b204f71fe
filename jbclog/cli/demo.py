"""`jbclog demo`: a whole run on virtual stations, through the real serial stack, in half a minute."""

from __future__ import annotations

import os
import tempfile
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.cli.streams import never_wait

if TYPE_CHECKING:
    from jbclog.app.run.run_record import Result

LEAST_S = 14.0  # heating up takes seven seconds, the faults the rest
DROPPED, OVERHEATED = "dde-2", "ucr-1"


@ends_with_errors_told
def demo(
    out: Path = typer.Option(Path("demo-runs"), "--out", "-o", metavar="DIR", help="The folder that the run's folder is made in."),
    seconds: float = typer.Option(20.0, min=LEAST_S, max=3600.0, metavar="S", help="How long to record, in seconds."),
    as_json: bool = options.AS_JSON,
) -> None:
    """Show it all on four virtual stations, from recipe to report.

    A recipe is applied and the run recorded at 5 or 10 Hz, through the real serial stack; one station raises an alarm, one drops
    out and comes back. The stations run in a process of their own, on pseudo-terminals (TCP where there are none), their
    wires as slow as real ones.

    \b
    Example:
      jbclog demo --out demo-runs
    """
    from jbclog.report.write import write_report

    never_wait()
    result = _record(out, seconds, quiet=as_json)
    page = write_report(result.folder)
    shown = _shown(result)
    if as_json:
        tell_json(
            {"run": str(result.folder), "report": str(page), "exit_code": result.exit_code.value, "shown": all(shown.values())}
        )
    else:
        _tell(result, page, shown)
    if not all(shown.values()):
        raise typer.Exit(1)


def _record(out: Path, seconds: float, *, quiet: bool) -> Result:
    from jbclog.app.run.plan import Metadata, RunOptions, make_plan
    from jbclog.app.run.runner import conduct
    from jbclog.cli.progress import BackgroundObserver, observer
    from jbclog.sim.process import SimProcess

    metadata = Metadata("demo", "DEMO-1", "demo board", (), {"note": "virtual stations"})
    with tempfile.TemporaryDirectory(prefix="jbclog-demo-") as folder:
        line, recipe = _files(Path(folder), seconds)
        tcp = None if hasattr(os, "openpty") else "127.0.0.1:0"
        if not quiet:
            note("four virtual stations: dde-1 and dde-2 with two tools each, the robot unit ucr-1, ale-1 with its solder feeder")
        with SimProcess(line, Path(folder) / "ports", tcp=tcp) as stations:
            plan = make_plan(RunOptions(stations.line_path, recipe, duration_s=seconds, metadata=metadata))
            shown = BackgroundObserver(observer(seconds, quiet=quiet))
            try:
                return conduct(plan, out, shown, missed=shown.missed)
            finally:
                shown.close()


def _files(folder: Path, seconds: float) -> tuple[Path, Path]:
    """The demo's line and recipe, with the faults placed within `seconds`."""
    source = files("jbclog.cli") / "demo_files"
    times = {"SECONDS_DROPOUT": seconds * 0.45, "SECONDS_OVERHEAT": seconds * 0.6}
    line = (source / "line.toml").read_text(encoding="utf-8")
    for word, moment in times.items():
        line = line.replace(word, f"{moment:.1f}")
    (folder / "line.toml").write_text(line, encoding="utf-8")
    (folder / "sn100c-demo.toml").write_text((source / "recipe.toml").read_text(encoding="utf-8"), encoding="utf-8")
    return folder / "line.toml", folder / "sn100c-demo.toml"


def _shown(result: Result) -> dict[str, bool]:
    """What a demo has to show, and whether this one did; from the record's facts."""
    stations = {facts.name: facts for facts in result.manifest.stations}
    dropped, overheated = stations.get(DROPPED), stations.get(OVERHEATED)
    return {
        "every station was recorded to the end": all(facts.outcome == "completed" for facts in stations.values()),
        f"{DROPPED} dropped out for three seconds and came back": bool(dropped and dropped.outages == 1),
        f"{OVERHEATED} raised its high-temperature alarm": bool(overheated and overheated.alarms),
        "every tool is in its safe state, as read back": all(
            facts.safe_state and set(facts.safe_state.values()) == {"verified"} for facts in stations.values()
        ),
    }


def _tell(result: Result, page: Path, shown: dict[str, bool]) -> None:
    manifest = result.manifest
    rows = sum(file.rows or 0 for file in manifest.files if file.path.startswith("samples/"))
    tell()
    tell(f"A recipe was applied to {len(manifest.stations)} stations, read back setting by setting, and {rows} rows were recorded.")
    for text, true in shown.items():
        tell(f"  {'yes' if true else 'NO '}  {text}")
    tell(f"Verdict by the recipe's acceptance limits: {manifest.verdict}.")
    reasons = "; ".join(finding.text for finding in result.findings) or "nothing was wrong"
    tell(f"A real `jbclog run` would have ended with exit code {result.exit_code.value}: {reasons}.")
    tell()
    tell(f"report    {page}   (open it in a browser)")
    tell(f"samples   {result.folder / 'samples'}   (pandas.read_parquet opens the folder)")
    tell(f"events    {result.folder / 'events'}")
    tell(f"manifest  {result.folder / 'manifest.json'}")
    tell(f"run       {result.folder}")
