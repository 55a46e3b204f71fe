"""An OMEGA that knows only its printed page is recorded, reported and judged on a real
pseudo-terminal, from the first question to the verdict.
"""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from support.command import jbclog
from support.invoked import invoked
from support.oracles.printed_omega import PageOmega, served
from support.product import check_run

RECIPE = (
    '[recipe]\nname = "states"\nrevision = 1\nfamilies = ["omega"]\n[acceptance]\ncoverage_percent'
    " = 90\nlongest_gap_s = 5\n"
)


def test_a_controller_that_says_a_and_no_more(tmp_path: Path) -> None:
    """Its state is null, not normal."""
    controller = PageOmega("a", delay_s=0.002)
    line, recipe = tmp_path / "line.toml", tmp_path / "states.toml"
    recipe.write_text(RECIPE)
    with served(controller) as far:
        line.write_text(
            f'[line]\nname = "x"\n[[station]]\nname = "omega-1"\nurl = "{far.url}"\nfamily ='
            ' "omega"\n'
        )
        # somebody looked for a JBC station: the first A is swallowed
        controller.receive(b"\x02RSMN\x03\x03", 0.0)
        run = jbclog(
            "run",
            recipe,
            "--line",
            line,
            "--out",
            tmp_path / "runs",
            "-d",
            "2s",
            "--rate",
            "1",
            "--json",
        )
    folder = Path(json.loads(run.stdout)["folder"])
    assert check_run(folder) == []
    assert set(controller.texts) == {"A", "B", "F"}
    samples = pd.read_parquet(folder / "samples")
    assert samples["solder_shortage"].isna().all()
    assert "solder_shortage=no_digit;clogged=no_digit" in set(samples["reasons"])
    why = {one.split("=")[1] for reasons in samples["reasons"] for one in reasons.split(";")}
    assert why <= {
        "no_digit",
        "skipped",
        "timeout",
        "disconnected",
    }  # a busy machine may be late once
    assert invoked("report", folder).exit_code in (0, 1)
    verdict = json.loads((folder / "report.json").read_text())["verdict"]
    coverage, gap = (
        rule
        for name in ("coverage", "longest_gap")
        for rule in verdict["rules"]
        if rule["name"] == name
    )
    assert (verdict["word"], run.returncode) == ("INCONCLUSIVE", 1)
    assert coverage["text"] == "Every answer lacked the digit of the state, so no state is known."
    assert (gap["result"], gap["text"]) == (coverage["result"], coverage["text"])
