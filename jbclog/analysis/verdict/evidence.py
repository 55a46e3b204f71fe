"""What is put before the judge: a folder of sealed tables and what the manifest is about to say of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jbclog.analysis.verdict.joint_measures import Joints
from jbclog.analysis.verdict.reached import Asks
from jbclog.core.rows import Goal, StationFacts, TipCheck

PortLedger = Mapping[str, Mapping[str, int]]
"""signal -> {"due": n, "ok": n, reason: n ...}."""

Ledger = Mapping[str, Mapping[str, PortLedger]]
"""station -> port (as text, as in the manifest) -> `PortLedger`."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """One run: `folder` holds `samples/`, `events/` and `settings/`, sealed.

    `exit_status` is the manifest's; ``lost`` means that a crash ended the run and its last moments are missing. `lost`
    says what else the record lacks, in a sentence. `verifications` are those that its ports stood on when it began. `joints` are
    those of each port whose recipe has a limit about them. `goals` are the numbers that the run was to end with. `asks` is what
    each station's recipe asks of its tools. `counts_lacking`: whether a setting that a station does not have is a deviation;
    release 0.1.0 said nothing of it, by what is version 1 of the rules as well.
    """

    folder: Path
    stations: Sequence[StationFacts]
    ledger: Ledger
    exit_status: str | None = "success"
    lost: str | None = None
    verifications: Sequence[TipCheck] = ()
    joints: Joints = field(default_factory=dict)
    goals: Sequence[Goal] = ()
    asks: Mapping[str, Asks] = field(default_factory=dict)
    counts_lacking: bool = True

    def port_ledger(self, station: str, port: int) -> PortLedger:
        """The ledger of one port; empty where nothing was ever due."""
        return self.ledger.get(station, {}).get(str(port), {})
