"""`jbclog check`: does a record still say what it said?"""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_run
from jbclog.cli.output import ends_with_errors_told, tell, tell_json
from jbclog.core.errors import UsageError


@ends_with_errors_told
def check(
    run: Path = options.RUN,
    head: str | None = typer.Option(
        None,
        "--head",
        metavar="HEAD",
        help="The head on a printed report, to compare: its 24 digits or all 64; the 16 of the first release.",
        show_default=False,
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Check a run's integrity.

    Recomputes hashes, counts, accounting, the chains of events and annotations, and the verdict by the rules of the run's own
    version; checks the report, and the runs before and after this one on the same line, where they are in the same folder. Prints
    each difference; exit code 1: there is one. Lines with "not covered" name the files whose bytes nothing vouches for; all
    others in the run's folder are covered. The last line has the run's head, a hash of all of it, to compare with a printed
    report.

    \b
    Example:
      jbclog check runs/20261121T013000Z-bench-3-k7qd
    """
    from jbclog.analysis.rejudge import held
    from jbclog.record.chains import HEAD, SHOWN, digits, short_head
    from jbclog.record.check import Finding, uncovered
    from jbclog.record.check import check as check_run
    from jbclog.record.manifest import NAME, manifest_sha256, read_manifest

    if head is not None and not HEAD.fullmatch(head):
        raise UsageError(f"--head {head}: give it as the report shows it, such as 3f2a-91bc-77de-0a12-5c08-b6e1")
    expect_run(run)
    found, notes = check_run(run, head), list[str]()
    if not found:  # else it is no wonder
        verdict = held(run, read_manifest(run))
        found, notes = [Finding(NAME, text) for text in verdict.differing], verdict.notes
    if read_manifest(run).state == "sealed":
        notes += [f"not covered: {file}: {text}" for file, text in uncovered(run, head)]
    if head is not None and digits(head) < SHOWN:
        notes.append(f"--head has {digits(head)} of 64 digits; newer reports show {SHOWN}, which prove more")
    own = manifest_sha256(run)
    if as_json:
        findings = [str(finding) for finding in found]
        tell_json({"run": str(run), "agrees": not found, "findings": findings, "notes": notes, "head": own})
    else:
        for text in [*notes, *map(str, found)]:
            tell(text)
        came = f"{len(found)} finding{'s' if len(found) > 1 else ''}" if found else "everything agrees"
        tell(f"{run}: {came} (head {short_head(own)})")
    if found:
        raise typer.Exit(1)
