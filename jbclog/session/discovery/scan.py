"""The scan of one port: line format after line format, until somebody answers or all were tried.

::

    open at a format -> listen, where it could be the binary protocol -> R-SMN to 01, to nobody, to 10 (-> OMEGA's A, twice)
         ↑ nobody answers                                                          ↓ somebody does
         └─────────────────────────────────────                 R-SMN again, until two say the same -> ask who (`who.py`)

Only questions are sent, and none that clears anything. What came and was no answer is kept for the diagnosis.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import cycle, islice

from jbclog.core.errors import LinkError
from jbclog.core.io_requests import Reopen, Steps, Wait
from jbclog.core.line_format import LineFormat
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.frame import Frame
from jbclog.session.discovery.found import PortReport, StationFound
from jbclog.session.discovery.probe import (
    MOST_KEPT,
    OMEGA_QUESTION,
    Came,
    Probe,
    is_binary,
    model_question,
    omega_answer,
    robot_answer,
)
from jbclog.session.discovery.trials import ANSWER_S, EXCHANGE, OMEGA_ANSWER_S, OMEGA_ASKED, ScanPlan, Trial
from jbclog.session.discovery.who import learn, not_settled, of_answer

OMEGA = "omega"
AGAIN = 4  # times that a station is asked for its model after it has said it, at the most


@dataclass(slots=True)
class Dial:
    """What the scan and whoever opens its port share: `line` is the format for the next opening; `stop` ends the scan soon."""

    line: LineFormat
    stop: bool = False


def scan(plan: ScanPlan, dial: Dial, report: PortReport) -> Steps[None]:
    """Fill `report`. Never raises for what a port or a station does."""
    began = (yield Wait(0.0)).now
    report.asked = plan.addresses
    this = _Scan(plan, dial, report, began)
    try:
        yield from this.try_all()
    except LinkError as error:
        report.broken = error
    report.flood = this.probe.flood
    report.seconds = this.probe.now - began
    report.stopped = dial.stop


class _Scan:
    """One scan while it goes on."""

    def __init__(self, plan: ScanPlan, dial: Dial, report: PortReport, began: float) -> None:
        self.probe = Probe()
        self.probe.now = began
        self._plan = plan
        self._dial = dial
        self._report = report
        self._until = began + plan.seconds

    def try_all(self) -> Steps[None]:
        for place, trial in enumerate(self._plan.trials):
            if self._is_over():
                self._report.untried += [rest.line for rest in self._plan.trials[place:]]
                return
            if (yield from self._try(trial)):
                return

    def _is_over(self) -> bool:
        return self._dial.stop or self.probe.now >= self._until

    def _try(self, trial: Trial) -> Steps[bool]:
        """Whether this line format settled it."""
        self._dial.line = trial.line
        self.probe.now = (yield Reopen()).now
        self._report.tried.append(trial.line)
        if trial.listens_s and (yield from self._hears_binary(trial)):
            return True
        if (yield from self._finds_robot(trial)):
            return True
        return trial.asks_omega and (yield from self._finds_omega(trial))

    def _hears_binary(self, trial: Trial) -> Steps[bool]:
        came = yield from self.probe.listen(trial.listens_s)
        self._keep(trial.line, came)
        if is_binary(came.rest):
            self._report.binary = trial.line
        return self._report.binary is not None

    def _finds_robot(self, trial: Trial) -> Steps[bool]:
        patience_s = ANSWER_S + trial.line.seconds(EXCHANGE)
        refused: StationFound | None = None
        for address in self._plan.addresses:
            if self._is_over():
                break
            came = yield from self.probe.ask(model_question(address), patience_s, robot_answer)
            answer = robot_answer(came.rest)
            if answer is None:
                self._keep(trial.line, came)
                continue
            found, is_meant = of_answer(answer, trial.line)
            if is_meant:
                yield from self._settle(answer, found, address, patience_s)
                return True
            refused = refused or found  # perhaps it wants the other addressing (docs/reference/contradictions.md, B-14)
        self._report.station = refused
        return refused is not None

    def _settle(self, first: Frame, found: StationFound, address: int | None, patience_s: float) -> Steps[None]:
        """Ask again until two answers say the same of model and address, then who it is; not of what one alone says.

        Asked is in turn who was told to have answered, and who was asked.
        """
        given = [first]
        for target in islice(cycle((found.address, address)), AGAIN):
            if self._dial.stop:
                break
            came = yield from self.probe.ask(model_question(target), patience_s, robot_answer)
            answer = robot_answer(came.rest)
            if answer is not None and answer in given:
                yield from self._learn(of_answer(answer, found.line)[0])
                return
            given += [] if answer is None else [answer]
        self._report.station = not_settled(found.line, given)

    def _finds_omega(self, trial: Trial) -> Steps[bool]:
        """Ask for one, more than once: the end of a JBC frame can take the STX of the first question for a digit of its sum."""
        for _ in range(OMEGA_ASKED):
            if self._is_over():
                break
            came = yield from self.probe.ask(OMEGA_QUESTION, OMEGA_ANSWER_S + trial.line.seconds(EXCHANGE), omega_answer)
            if omega_answer(came.rest) is not None:
                yield from self._learn(StationFound(trial.line, None, FAMILIES[OMEGA]))
                return True
            self._keep(trial.line, came)
        return False

    def _learn(self, found: StationFound) -> Steps[None]:
        self._report.station = found
        try:
            self.probe.now = yield from learn(found, self.probe.now)
        except LinkError:
            found.trouble = "the link broke while it was asked"
            raise

    def _keep(self, line: LineFormat, came: Came) -> None:
        """Note what came and was no answer."""
        self._report.echoed |= came.echoed
        if came.rest:
            kept = self._report.garbage.get(line, b"") + came.rest
            self._report.garbage[line] = kept[:MOST_KEPT]
