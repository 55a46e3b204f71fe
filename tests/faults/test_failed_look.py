"""An error of the program in what the recorder repeats each second: the run continues, with one
line in its messages, and what else it repeats is done.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from jbclog.app.run import recorder
from jbclog.app.run.runner import conduct
from jbclog.core.goal import Goal
from jbclog.session.run.context import SessionContext
from support.records.few_rows import table
from support.virtual.recorded_run import Nobody, plan_in

LINE = """
[line]
name = "bench"

[[station]]
name = "dde-1"
url = "/dev/nowhere"
family = "dde"
"""


class Shown(Nobody):
    """Counts how often the run was shown, the last thing of each second."""

    times = 0

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None:
        self.times += 1


def test_it_is_one_event_and_no_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(_: recorder.Recorder) -> None:
        raise ZeroDivisionError("injected")

    monkeypatch.delenv("JBCLOG_TRACEBACK", raising=False)
    monkeypatch.setattr(recorder.Recorder, "_look_at_clock", broken)
    monkeypatch.setattr(recorder, "LOOK_EVERY_S", 0.0)  # several times before the port is not there
    shown = Shown()
    result = conduct(plan_in(tmp_path, LINE, duration_s=1.0, guard=False), tmp_path, shown)
    assert shown.times > 0
    events = table(result.folder, "events").to_pylist()
    (failed,) = [one for one in events if one["kind"] == "run.look_failed"]
    assert failed["severity"] == "warning"
    assert failed["text"] == (
        "Look at the clock: internal error, ZeroDivisionError: injected. The run"
        " continues, and it is tried again (set JBCLOG_TRACEBACK=1 to see where; please report it)."
    )
    assert capfd.readouterr() == ("", "")
