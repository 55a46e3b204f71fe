"""The command `jbclog`, run as a person runs it, and what the virtual stations saw of it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from support.product import MAIN, committed_samples
from support.warm_start import Warm

PROFILES = Path(__file__).parents[2] / "profiles"
RECIPE = PROFILES / "recipes" / "sn100c-tht.toml"
BENCH = PROFILES / "lines" / "bench.toml"


def recipe_text(name: str, *families: str, more: str = "") -> str:
    """A recipe that puts the tools to work at 350 °C, and lets those that rest cool. `more` begins
    in the table `[run]`.
    """
    return f"""[recipe]
name = "{name}"
revision = 1
families = {json.dumps(families)}
[temperature]
select_c = 350
[sleep]
delay_min = 5
[hibernation]
delay_min = 30
[run]
status = "working"
{more}"""


def jbclog(
    *arguments: str | Path, timeout: float = 200.0, cwd: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run the command to its end, in a process that has everything imported."""
    words = list(map(str, arguments))
    with Warm(words, cwd) as process:
        told, notes = process.communicate(timeout=timeout)
    return subprocess.CompletedProcess(words, process.returncode, told, notes)


def fresh(*arguments: str | Path, timeout: float = 200.0) -> subprocess.CompletedProcess[str]:
    """The same in an interpreter of its own."""
    command = [sys.executable, "-c", MAIN, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


def started(*arguments: str | Path) -> subprocess.Popen[str]:
    """The command, left running."""
    return Warm(list(map(str, arguments)))


def only_run(out: Path) -> Path:
    """The folder of the run in a folder that has nothing else."""
    (folder,) = out.iterdir()
    return folder


QUESTION = re.compile(rb"\x02\d{4}([RW][ -~]*)\x03", re.DOTALL)


@dataclass(frozen=True)
class WireLog:
    """What `jbclog sim --log` wrote: the stations' own memory of the wire."""

    path: Path

    def questions(self, station: str) -> list[str]:
        """The questions to a station in order, without addresses: ``WPS100001``. A busy station
        hears several at once.
        """
        whole, _, _ = self.path.read_text().rpartition("\n")  # the last line may be being written
        lines = [json.loads(line) for line in whole.splitlines()]
        heard = b"".join(
            bytes.fromhex(one["hex"])
            for one in lines
            if one["station"] == station and one["kind"] == "question"
        )
        return [question.decode() for question in QUESTION.findall(heard)]

    def writes(self, station: str) -> list[str]:
        return [text for text in self.questions(station) if text.startswith("W")]


def until(true: Callable[[], bool], seconds: float = 60.0, every_s: float = 0.05) -> bool:
    """Wait until `true`; give whether it came to that. A look that takes long is taken rarely: what
    is waited for computes, too.
    """
    end = time.monotonic() + seconds
    while (began := time.monotonic()) < end:
        if true():
            return True
        time.sleep(max(every_s, min(3 * (time.monotonic() - began), 1.0)))
    return true()


def expect_terminated(run: subprocess.Popen[str]) -> None:
    """Tell a run to end. On a busy machine its station may just be late with an answer, and the run
    says so.
    """
    run.terminate()
    _, told = run.communicate(timeout=200)
    is_late = run.returncode == 3 and "not reachable when the run ended" in told
    assert run.returncode == 143 or is_late, told


def is_sampling(out: Path) -> bool:
    """Whether a run below `out` has committed rows of samples."""
    return sampled(out) > 0


def sampled(out: Path) -> int:
    """How many rows of samples the open runs below `out` have committed. It is asked many times,
    beside what is waited for: the stores count them, and none is read.
    """
    return sum(map(committed_samples, out.glob("*/")))
