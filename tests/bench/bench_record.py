"""What the record costs and loses, beside another tree's in the same run, in turns.

    git worktree add --detach /tmp/other $(git log --grep='^Oracle: 1$' --format=%H -1)
    python tests/bench/bench_record.py /tmp/other

Each case (`record_cases.py`) runs in a process of its own with either tree on its path, in this
Python. The claims are those of a journal of frames and of parts sorted by port, against the store
in SQLite that came before. `--hours` is the length of the run that is recovered.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from common import at_most, judge, show

HERE = Path(__file__).parents[2]
CASES = Path(__file__).with_name("record_cases.py")


@dataclass(frozen=True)
class Claim:
    """A figure of a case: at most `ratio` of the other tree's, and at most `most`."""

    case: str
    figure: str
    ratio: float | None = None
    most: float | None = None


CLAIMS = (
    Claim("keep", "CPU of both, µs a row", ratio=1.0),
    Claim("size", "bytes of a sealed row, 20 s × 2 ports", ratio=1.15),
    Claim("size", "bytes of a sealed row, 8 ports", ratio=1.0),
    Claim("day", "one port of 64, ms", ratio=0.1),
    Claim("day", "one port of 64, most in Arrow, MB", ratio=0.1),
    Claim("memory", "memory of the sealing child, MB", most=500.0),
    Claim("recovery", "recovery, s", ratio=0.5),
    Claim("follow", "a follower behind, s at most", most=1.2),
    Claim("killed", "lost by a kill, s at most", most=1.2),
)


def main() -> int:
    given = _given()
    lengths = {
        "keep": 600.0,
        "size": 3600.0,
        "day": given.hours * 150,  # a day of 64 ports takes hours to be made: 1/24 of it
        "memory": 400.0,
        "recovery": given.hours * 3600,
        "follow": 30.0,
        "killed": 10.0,
    }
    trees = (HERE, given.tree.resolve())
    figures: tuple[dict[str, list[float]], dict[str, list[float]]] = ({}, {})
    for turn in range(given.rounds):
        for case in given.case or lengths:
            for which in (0, 1) if turn % 2 else (1, 0):
                for name, value in _measured(trees[which], case, lengths[case]).items():
                    figures[which].setdefault(name, []).append(value)
    ours, others = figures
    show(
        f"{given.rounds} rounds",
        ("median of rounds", "this tree", "the other", "of it"),
        [
            [name, median(ours[name]), median(others[name]), _ratio(ours[name], others[name])]
            for name in ours
        ],
    )
    verdicts = []
    for claim in CLAIMS:
        values = ours.get(claim.figure)
        if values is None:
            continue
        if claim.ratio is not None:
            ratio = _ratio(values, others[claim.figure])
            verdicts.append(at_most(f"{claim.figure}: of the other's", ratio, claim.ratio))
        if claim.most is not None:
            verdicts.append(at_most(claim.figure, max(values), claim.most))
    return judge(verdicts)


def _given() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tree", type=Path, help="another working tree")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--case", action="append", help="only this one; again: more")
    return parser.parse_args()


def _measured(tree: Path, case: str, seconds: float) -> dict[str, float]:
    paths = os.pathsep.join([str(tree), str(tree / "tests")])
    with TemporaryDirectory(prefix="jbclog-bench-") as folder:
        done = subprocess.run(
            [sys.executable, "-P", str(CASES), case, folder, f"{seconds}"],
            env=os.environ | {"PYTHONPATH": paths},
            stdout=subprocess.PIPE,
            check=True,
        )
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def _ratio(ours: list[float], others: list[float]) -> float:
    """Return the median of the ratios of the rounds."""
    return median(mine / other for mine, other in zip(ours, others, strict=True))


if __name__ == "__main__":
    sys.exit(main())
