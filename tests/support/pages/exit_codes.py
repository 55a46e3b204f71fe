"""docs/reference/exit-codes.md: what the shell sees, and which code wins."""

from __future__ import annotations

from collections.abc import Mapping

from jbclog.core.outcome import SEVEREST_FIRST, Exit
from support.pages.md_table import MADE, table

MEANINGS: Mapping[Exit, str] = {
    Exit.FINE: "Success.",
    Exit.NOT_FINE: (
        "Finished, and found a problem. `run`, `batch`: a verdict other than ACCEPT or NOT JUDGED,"
        " an alarm, a changed setting, fewer units or joints than required. `audit`: maintenance is"
        " due. `check`, `publish --check`, `doctor`: a finding. `alarms`: an unacknowledged alarm. `safe --wait`: a tool that is still warm."
    ),
    Exit.USAGE: "Wrong usage, recipe, line or jobs file. Nothing was sent.",
    Exit.STATION: (
        "A station did not answer at the start, is not in Robot mode, refused the recipe or cannot"
        " keep the rate; the run then starts on none (with `--allow-missing`, only if none starts)."
        " Or a station was disconnected at the end, or another run holds a port."
    ),
    Exit.RECORD: (
        "The record is incomplete: crash, disk, hashes. `publish`: a run was refused, or its place"
        " cannot be read or written."
    ),
    Exit.UNSAFE: (
        "A tool could not be put in its safe state. The last lines name station, port and last"
        " temperature."
    ),
    Exit.OUTPUT: (
        "Standard output could not be written (full disk). In place of 0 or 1; what the command"
        " recorded or sent is as it would have been. A pipe that its reader closes is no error."
    ),
    Exit.INTERRUPTED: (
        "SIGINT (Ctrl-C) before a stated end (duration, units or joints). Record closed, tools"
        " safe. Also `watch` at Ctrl-C."
    ),
    Exit.TERMINATED: "The same by SIGTERM or SIGHUP; also `watch --web` at SIGTERM.",
}

RULES = """
- Ctrl-C in a run without a stated end is its normal end.
- A lost and restored connection is an event and lowers the coverage; it has no exit code.
- An alarm counts while the tool is working, once it has come within 10 °C of its setpoint. A flag that is set at the first reading is
  `alarm.before_run` and does not count.
- An internal error of jbclog exits with 1; `JBCLOG_TRACEBACK=1` shows where it is.
"""


def page() -> str:
    """The whole page."""
    rows = [(str(int(one)), MEANINGS[one]) for one in Exit]
    order = ", ".join(str(int(one)) for one in SEVEREST_FIRST)
    wins = f"Where several apply, the most severe wins, in this order: {order}."
    return f"{MADE}\n\n# Exit codes\n\n{table(('code', 'meaning'), rows)}\n\n{wins}\n{RULES}"
