"""`jbclog check`: the integrity of a run."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_run_or_published
from jbclog.cli.output import echo, echo_json, reports_errors
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text


@reports_errors
def check(
    run: Path = options.RUN_OR_PUBLISHED,
    head: str | None = typer.Option(
        None,
        "--head",
        metavar="HEAD",
        help="Fingerprint on a printed report: 16, 24 or 64 digits.",
        show_default=False,
    ),
    from_capture: bool = typer.Option(
        False, "--from-capture", help="Reproduce the run from its capture, compare every row."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Check a run's integrity.

    Recomputes hashes, counts, accounting, the event and annotation chains, and the verdict by the
    rules of this version. Compares stored joints with the bounds that the raw power sets.
    Checks the previous and next run on the same line if they are in
    the same folder. Prints each difference; exit code 1: at least one. "not covered" names a file
    of which something is not compared. The last line shows the run's fingerprint, to compare with a
    printed report. A published run (TABLE/RUN) is copied and checked without its report.

    --from-capture, for a run recorded with --capture: runs the sessions again, without ports, on
    what they received, and compares samples, events, settings and counters of all stations, except
    times and the recorder's own events. Where this version asks a station something else, the
    session ends, which is a finding.

    \b
    Example:
      jbclog check runs/20261121T013000Z-bench-3-k7qd
    """
    from jbclog.record.chains import HEAD
    from jbclog.record.published import whole_run

    if head is not None and not HEAD.fullmatch(head):
        raise UsageError(
            f"--head {head}: give the fingerprint as the report shows it, such as"
            " 3f2a-91bc-77de-0a12-5c08-b6e1"
        )
    expect_run_or_published(run)
    with whole_run(run) as folder:
        _check(run, folder, head, from_capture=from_capture, as_json=as_json)


def _check(run: Path, folder: Path, head: str | None, *, from_capture: bool, as_json: bool) -> None:
    """Check the run in `folder`, which is `run`, or a copy of that published run."""
    from jbclog.analysis.joint_bounds import beyond_bounds
    from jbclog.analysis.rejudge import check_verdict
    from jbclog.analysis.run import open_run
    from jbclog.record.chains import SHOWN, digits, short_head
    from jbclog.record.check import Finding
    from jbclog.record.check import check as check_run
    from jbclog.record.clock_steps import start_doubt
    from jbclog.record.cross_check import uncovered
    from jbclog.record.manifest import NAME, manifest_sha256, read_manifest
    from jbclog.record.published import shown_path

    found = check_run(folder, head, with_report=folder == run)
    notes: list[str] = []
    bare: list[tuple[str, str]] = []
    if not found:  # a changed record would change the verdict, too
        verdict = check_verdict(folder, read_manifest(folder))
        found = [
            *(Finding(NAME, text) for text in verdict.differing),
            *(Finding("joints", text) for text in beyond_bounds(open_run(folder))),
        ]
        notes = verdict.notes
    of_capture: list[str] = []
    is_cut_off = False
    compared: dict[str, dict[str, int]] | None = None
    if from_capture and not found:
        from jbclog.app.reproduce import compare_from_capture

        comparison = compare_from_capture(folder)
        texts = [*comparison.differences, *comparison.uncompared]
        found = [Finding("wire/", text) for text in texts]
        of_capture = [*comparison.notes, str(comparison)]
        is_cut_off = bool(comparison.notes)
        compared = comparison.as_json()
    elif from_capture:
        of_capture.append("not reproduced from the capture, because of other findings")
    manifest = read_manifest(folder)
    if manifest.is_sealed:
        bare += uncovered(folder, head)
    apart = [f"{count_text(len(bare), 'file')} not covered"] * bool(bare)
    apart += ["verdict not recomputed"] * bool(notes)
    apart += ["the capture ends early"] * is_cut_off
    notes += [f"not covered: {file}: {text}" for file, text in bare]
    clock_wrong = start_doubt(manifest.start, manifest.clock_steps or ())
    if clock_wrong:
        notes.append(clock_wrong)
        apart.append("wrong times")
    if head is not None and digits(head) < SHOWN:
        notes.append(f"--head has {digits(head)} of 64 digits; newer reports show {SHOWN}")
    notes += of_capture
    own, place = manifest_sha256(folder), shown_path(run)
    if as_json:
        findings = [str(finding) for finding in found]
        facts = {"compared": compared} if from_capture else {}
        echo_json(
            {
                "run": folder.absolute().name,
                "folder": str(place),
                "agrees": not found,
                "findings": findings,
                "notes": notes,
                "head": own,
                **facts,
            }
        )
    else:
        echo(*notes, *map(str, found))
        none = "no differences" + f" in what is covered; {', '.join(apart)}" * bool(apart)
        result = count_text(len(found), "finding") if found else none
        echo(f"{place}: {result} (fingerprint {short_head(own)})")
    if found:
        raise typer.Exit(1)
