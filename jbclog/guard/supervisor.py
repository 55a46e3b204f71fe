"""The recorder's side of the guard: start it, lease what a run may leave hot, renew, and replace a
dead guard.
"""

from __future__ import annotations

import fcntl
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

from jbclog.core.children import await_end, kill
from jbclog.core.errors import StartRefused
from jbclog.core.rows import StationFacts
from jbclog.core.states import SafetyResult, StationOutcome
from jbclog.guard import lease
from jbclog.guard.continuity import Proof
from jbclog.guard.lease import StationLease
from jbclog.guard.watch import (
    ANSWERED,
    BEAT,
    DOUBTED,
    END,
    FAILED,
    FAMILIES,
    PROOF,
    READY,
    GuardLost,
)

READY_S: Final = 10.0
END_S: Final = 2.0
KILL_S: Final = 0.2
TAKEN_OVER_S: Final = 12.0
UNANSWERED_MOST: Final = 4  # renewals: at most 1.25 s with a guard that does not answer
# the most that Linux allows every user: holds the leases of any line while the guard starts
PIPE_SIZE: Final = 1 << 20
ANSWERED_EVERY_S: Final = 1.0  # a later answer of a station is sent after this time
ANSWERED_AT_ONCE: Final = 32  # stations in a line, so that it is written whole or not at all
UNGUARDED: Final = "if this recorder dies, the tools stay hot"

Report = Callable[[str, str], None]
"""Records a critical event, given its kind and text."""


class RunGuard:
    """The guard of a run, from `start` to `end`; does not watch before `start`."""

    def __init__(self) -> None:
        self._begun: GuardProcess | None = None
        self._supervisor: GuardSupervisor | None = None

    def begin(self, folder: Path) -> None:
        """Launch the process, which is ready after a tenth of a second; `start` waits for it."""
        with suppress(StartRefused):  # `start` tries again, and raises it
            self._begun = GuardProcess(folder)

    def start(self, folder: Path, report: Report) -> None:
        """Start the guard before anything is sent to a station. Raises StartRefused."""
        begun, self._begun = self._begun, None
        self._supervisor = GuardSupervisor(folder, report, begun)

    def update(self, facts: StationFacts) -> None:
        """Lease what may be hot. Call this before the first write to a tool is sent."""
        if self._supervisor is not None and facts.asked_safe_state:
            self._supervisor.lease(lease_of(facts))

    def renew(self) -> None:
        if self._supervisor is not None:
            self._supervisor.renew()

    def identify(self, families: Sequence[str], proofs: Iterable[Proof]) -> None:
        """Send what is known of the stations now (`guard.continuity`): the families of the line,
        and a proof of each station that has one.
        """
        if self._supervisor is not None:
            self._supervisor.identify(tuple(families), {proof.station: proof for proof in proofs})

    def end(self) -> None:
        """End the guard after all sessions have ended by themselves, or none has begun."""
        if self._begun is not None:
            self._begun.end()
        if self._supervisor is not None:
            self._supervisor.end()

    def take_over(self) -> None:
        """Let the guard make tools safe after sessions failed and all ports are closed, and wait
        for it.
        """
        if self._supervisor is not None:
            self._supervisor.take_over()


def lease_of(facts: StationFacts) -> StationLease:
    """Return what to make safe if the recorder dies now: every touched tool, until its station has
    ended with it verified safe.
    """
    is_over = facts.outcome != StationOutcome.RUNNING
    return StationLease(
        name=facts.name,
        url=facts.url,
        baudrate=facts.baudrate,
        format=facts.format,
        address=facts.address,
        family=facts.family,
        model=facts.model,
        software=facts.software,
        safe_state=facts.asked_safe_state,
        ports=tuple(
            port
            for port in facts.touched
            if not (is_over and facts.safe_state.get(port) == SafetyResult.VERIFIED)
        ),
        feeds=facts.may_feed,
        model_accepted=facts.model_accepted,
        suction=tuple(facts.suction),
    )


class GuardSupervisor:
    """Keeps one guard alive for the run in `folder`, first the process `begun`. Raises StartRefused
    if it does not start.
    """

    def __init__(self, folder: Path, report: Report, begun: GuardProcess | None = None) -> None:
        self._folder = folder
        self._report = report
        self._leases: dict[str, StationLease] = {}
        self._families: tuple[str, ...] = ()
        self._proofs: dict[str, Proof] = {}
        self._is_handed_over = False  # the guard owns the lease file from then on
        self._guard: GuardProcess | None = begun or GuardProcess(folder)
        self._guard.await_ready()

    @property
    def pid(self) -> int | None:
        """Process id of the guard; None if none is running."""
        return self._guard.pid if self._guard else None

    def lease(self, station: StationLease) -> None:
        """Send what to make safe on a station."""
        self._leases[station.name] = station
        self._call(lambda guard: guard.lease(station))

    def renew(self) -> None:
        """Send a sign of life; call this every `RENEW_S`."""
        self._call(lambda guard: guard.renew())

    def identify(self, families: tuple[str, ...], proofs: dict[str, Proof]) -> None:
        """Send what changed of the stations' identities."""
        self._families, self._proofs = families, proofs
        if self._guard is not None:
            self._guard.identify(families, proofs)

    def end(self) -> None:
        """End the guard: every tool is safe, or reported as not safe."""
        if self._guard is not None:
            self._guard.end()
            self._guard = None
        if not self._is_handed_over:
            # a lost guard left the lease open, and the next start would expect hot tools
            with suppress(Exception):
                lease.write_leases(self._folder, ())

    def take_over(self) -> None:
        """Let the guard make leased tools safe after the recorder failed, and wait for it."""
        self._is_handed_over = True
        if self._guard is not None:
            self._guard.take_over()
            self._guard = None

    def _call(self, what: Callable[[GuardProcess], None]) -> None:
        if self._guard is None:
            return
        try:
            what(self._guard)
        except GuardLost as lost:
            self._replace(lost)

    def _replace(self, lost: GuardLost) -> None:
        former, self._guard = self._guard, None
        self._report("guard.lost", f"The guard was lost ({lost}) and is being replaced.")
        try:
            self._guard = GuardProcess(self._folder, self._leases.values(), former)
            self._guard.identify(self._families, self._proofs)
        except (GuardLost, StartRefused) as error:
            self._report("guard.lost", f"The guard could not be replaced ({error}); {UNGUARDED}.")
        if former is not None:
            former.kill()


class GuardProcess:
    """One guard process of the run in `folder`. Raises StartRefused if the system cannot start it,
    and GuardLost if its pipe cannot hold the `leases`.

    The recorder may die at any moment, so the process has all it needs from its first instruction:
    the leases are in its pipe, and it kills the `former` guard itself. The recorder never waits for
    the pipe; a guard that does not read it is lost.
    """

    def __init__(
        self,
        folder: Path,
        leases: Iterable[StationLease] = (),
        former: GuardProcess | None = None,
    ) -> None:
        # -P: a file in the user's current folder must not be imported as a module
        command = [
            sys.executable,
            "-P",
            "-m",
            "jbclog.guard",
            str(folder),
            "--recorder",
            str(os.getpid()),
        ]
        self._unanswered = 0
        self._sent: dict[str, StationLease] = {}
        self._families: tuple[str, ...] = ()
        self._proofs: dict[str, Proof] = {}
        after = [former.descriptor] if former is not None and former.descriptor is not None else []
        if former is not None and not after:
            former.kill()
        try:
            with _reading_end() as (stdin, self._pipe), _signals_blocked():
                for station in leases:
                    self.lease(station)
                self._process = subprocess.Popen(
                    [*command, *map(str, after)],
                    stdin=stdin,
                    stdout=subprocess.PIPE,
                    start_new_session=True,
                    bufsize=0,
                    pass_fds=after,
                )
        except OSError as error:
            raise StartRefused(
                f"the guard could not be started ({error}); --no-guard runs without one"
            ) from error
        assert self._process.stdout is not None
        self._answers = self._process.stdout.fileno()
        os.set_blocking(self._answers, False)
        self.descriptor: int | None = None
        with suppress(AttributeError, OSError):  # not every system has them
            self.descriptor = os.pidfd_open(self._process.pid)

    @property
    def pid(self) -> int:
        return self._process.pid

    def await_ready(self) -> None:
        """Wait until it watches. Raises StartRefused."""
        if not self._can_be_read_within(READY_S) or not os.read(self._answers, len(READY)):
            self.kill()
            raise StartRefused(
                "the guard did not start; its reason stands above. --no-guard runs without one"
            )

    def kill(self) -> None:
        """Kill the process, without waiting long if a hanging disk keeps it from ending."""
        kill(self._process, KILL_S)
        self._close()

    def _close(self) -> None:
        if self._process.stdout is not None and not self._process.stdout.closed:
            self._process.stdout.close()
            os.close(self._pipe)
            if self.descriptor is not None:
                os.close(self.descriptor)

    def lease(self, station: StationLease) -> None:
        """Send a changed lease. Raises GuardLost."""
        if self._sent.get(station.name) != station:
            self._send(station.to_json())
            self._sent[station.name] = station

    def renew(self) -> None:
        """Send a beat, and check that the guard answers. Raises GuardLost."""
        if self._has_answered():
            self._unanswered = 0
        if self._unanswered >= UNANSWERED_MOST:
            raise GuardLost("it does not respond")
        self._send(BEAT)
        self._unanswered += 1

    def identify(self, families: tuple[str, ...], proofs: dict[str, Proof]) -> None:
        """Send what changed of the stations' identities, as far as the pipe takes it; the next call
        sends the rest.
        """
        if families != self._families and self._offer(FAMILIES, families):
            self._families = families
        for name in self._proofs.keys() - proofs.keys():
            if self._offer(DOUBTED, name):
                del self._proofs[name]
        later = {}
        for name, proof in proofs.items():
            known = self._proofs.get(name)
            if known is None or proof != replace(known, answered_at=proof.answered_at):
                if self._offer(PROOF, asdict(proof)):
                    self._proofs[name] = proof
            elif proof.answered_at - known.answered_at >= ANSWERED_EVERY_S:
                later[name] = proof
        self._send_later(list(later.values()))

    def _send_later(self, proofs: Sequence[Proof]) -> None:
        for first in range(0, len(proofs), ANSWERED_AT_ONCE):
            part = proofs[first : first + ANSWERED_AT_ONCE]
            if self._offer(ANSWERED, {proof.station: proof.answered_at for proof in part}):
                self._proofs |= {proof.station: proof for proof in part}

    def _offer(self, kind: str, facts: object) -> bool:
        """Send a line that may be lost; return True if it was sent. A pipe takes so few bytes as a
        whole, or none of them.
        """
        data = f"{kind} {json.dumps(facts)}\n".encode()
        if len(data) > select.PIPE_BUF:
            return False
        try:
            os.write(self._pipe, data)
        except OSError:  # the pipe is full, or `renew` notices that the guard is gone
            return False
        return True

    def end(self) -> None:
        """Send the end and wait for the process: there is nothing left to guard."""
        with suppress(GuardLost):
            self._send(END)
        await_end(self._process, END_S)
        self._close()

    def take_over(self) -> None:
        """Let it take over now, with the ports closed; wait until it has done what it can."""
        with suppress(GuardLost):
            self._send(FAILED)
            end = time.monotonic() + TAKEN_OVER_S
            while self._can_be_read_within(end - time.monotonic()) and self._has_answered():
                pass  # until it closes its end
        await_end(self._process, KILL_S)  # it may try for minutes what it could not make safe
        self._close()

    def _can_be_read_within(self, seconds: float) -> bool:
        watched = select.poll()  # unlike select(), it takes any descriptor
        watched.register(self._answers, select.POLLIN)
        return bool(watched.poll(max(seconds, 0.0) * 1000))

    def _has_answered(self) -> bool:
        """Return True if it has answered since the last call. Raises GuardLost if it is gone."""
        try:
            if os.read(self._answers, 4096):
                return True
        except BlockingIOError:
            return False
        raise GuardLost("it ended")

    def _send(self, line: str) -> None:
        data = line.encode() + b"\n"
        try:
            sent = os.write(self._pipe, data)
        except OSError as error:  # BlockingIOError: the pipe is full
            raise GuardLost(str(error)) from error
        if sent < len(data):
            raise GuardLost("it does not read")


@contextmanager
def _reading_end() -> Iterator[tuple[int, int]]:
    """Make a pipe. Closes the reading end on exit, the writing end only on an error."""
    reading, writing = os.pipe()
    try:
        os.set_blocking(writing, False)
        with suppress(OSError, AttributeError):
            fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, PIPE_SIZE)
        yield reading, writing
    except BaseException:
        os.close(writing)
        raise
    finally:
        os.close(reading)


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Block signals that end a run, so that the process started within blocks them from its first
    instruction: Ctrl-C reaches all processes of a terminal.
    """
    before = signal.pthread_sigmask(
        signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    )
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
