"""The one file through which the tests of the contract reach the package (their list:
tests/contract.toml).

A test takes what it needs of the package from here, never from a module. So a part can move, or be
built anew, while the test stays as it is:

- `NAMES`: classes, functions and constants, by the module that has them. A name that says too
  little by itself has another one for tests: `END=WATCH_END`. Each is imported when a test takes
  it, so a test loads what it tests.
- `Session`: a session is made of an order, a journal and a clock; its facts and ports.
- `pull`, `send`, `throw`: a session's steps, whatever they are.
- `PATCHED` and `patch`: what tests replace.
- `MAIN`, `PATIENT_GUARD`, …: programs that name inner parts, for other processes.
- `open_store`, `seal`, `files_of_rows`, …: a run in progress, its files, and how it is sealed.
- `captured_rows`, `reproduction`, …: a capture; `evaluated_alarms`, `contradictions`, …: what an
  inner part gives, in a form that belongs to the tests.

Adapters of `tests/support` may change with the package, but reach it from here, too, as far as the
list names them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import WeakValueDictionary

if TYPE_CHECKING:
    import pytest

    from jbclog.app.run.run_record import RunRecord
    from jbclog.config.recipe import Recipe
    from jbclog.core.capture_rows import CaptureRow
    from jbclog.core.clock import Clock, UtcOffset
    from jbclog.core.errors import LinkError, LinkFlooded, RecordError, StationError
    from jbclog.core.io_requests import IoResult, Request, Steps
    from jbclog.core.locks import FolderLock
    from jbclog.core.quantities import Value
    from jbclog.core.rows import EventRow, Journal, SampleRow, SettingRow, StationFacts
    from jbclog.protocol.client.interface import Permit
    from jbclog.protocol.client.omega import OmegaStation
    from jbclog.protocol.commands.command import Command
    from jbclog.protocol.commands.family import Family
    from jbclog.record.frames import Commit, Frame
    from jbclog.record.manifest import Manifest
    from jbclog.record.run_journal import RunJournal
    from jbclog.session.run.context import SessionContext
    from jbclog.session.run.pace import SamplingPlan
    from jbclog.session.run.reconnection import Reconnection
    from jbclog.session.run.state import PortState, ReadingCount, StationState
    from jbclog.session.run.task import StationTask
    from jbclog.session.scheduler import ScheduledRead
    from jbclog.transport.port import ObjectPort

T = TypeVar("T")

if TYPE_CHECKING:
    package: Any
    """The package itself, of whose public names a test speaks."""

PACKAGE = Path(__file__).parents[2] / "jbclog"
"""The package's folder, for tests that read its text."""

NAMES = """
analysis.alarms.from_record
    flag_episodes
analysis.alarms.state_machine
    Detector
analysis.charts
    Charted
analysis.derived_schemas
    DERIVED_SCHEMAS
analysis.opening
    open_run
analysis.rejudge
    check_verdict
analysis.run
    Run
analysis.run_gaps
    gap_rows GAPS_SCHEMA
analysis.runs
    open_runs Runs
analysis.spc
    individuals=individuals_chart Refused=NoChart
analysis.verdict
    RULES=VERDICT_RULES
analysis.verdict.rules
    NOT_AS_PLANNED
app.audit.questions
    SurveyTarget
app.audit.records
    error_events
app.audit.survey
    _open=open_for_survey AT_ONCE run_that_holds
app.connection
    ask=ask_station target_in
app.discovery
    search=search_ports text_of=discovery_text
app.doctor
    Fine look_at_stations
app.port_access
    PortAccess
app.publish
    publish=publish_runs
app.reproduce
    compare_from_capture open_captured=open_capture run_again=run_captured_again
app.run.first_run
    FIRST_DURATION fitting_recipe
app.run.options
    Metadata RunOptions
app.run.plan
    make_plan Plan=RunPlan StationPlan
app.run.recorder
    Recorder=RunRecorder
app.run.run_record
    Observer Result=RunResult RunRecord
app.run.runner
    conduct=conduct_run
app.safe_state
    DONE_S=SAFE_DONE_S GUARD_S=SAFE_GUARD_S KILLED_S=SAFE_KILLED_S TERM_S=SAFE_TERM_S
cli
    main=command_main
cli.app
    app=command_line RECORDING=RECORDING_COMMANDS
cli.front_page
    COMMANDS=FRONT_PAGE_COMMANDS page=help_page
cli.watch
    NICENESS=WATCH_NICENESS
config.durations
    span_s
config.line
    load_line parse_line StationSpec
config.load_recipe
    parse_recipe
config.recipe
    CAN_HEAT CANNOT_HEAT COMMAND_OF Recipe
config.recipe_sections
    Omega
config.recipe_settings
    condition_of
config.sim_spec
    FaultKind SimSpec
core.capture_rows
    CaptureRow LinkRow ResultRow
core.chain
    line_of=durable_line
core.clock
    elapsed VirtualClock
core.errors
    AnswerContradicted AnswerCorrupt AnswerFormat AnswerTimeout Ignored ImplausibleAnswer
    LinkError LinkFlooded ModelUnknown NotReceived NotSupported OutOfRange PortBusy
    PortForbidden PortMissing Problems RecordError Refusal RobotModeOff StartRefused
    StationError StationSilent Unsafe=UnsafeError UsageError WriteForbidden
core.files
    Kind=FileKind LIMITS=FILE_LIMITS
core.goal
    Goal
core.io_requests
    Ask do IoResult Listen relay Reopen Request RunEnded Steps Wait
core.locks
    FolderLock is_held=is_lock_held NAME=RUN_LOCK
core.operating_system
    NO_RECORDING
core.outcome
    Exit exit_code findings
core.quantities
    AlarmDelay AlarmLimit Choice Delay DigitWord Flags HexLength HIGHEST_C Number OFF
    OFF_ON_WIRE Quantity Scaled Text text_of Unsigned Value Whole
core.rows
    COLUMN CounterRow EventRow quality_of reasons_text SAMPLE_COLUMNS SampleRow SettingRow
    Severity SIGNAL_COLUMNS SIGNAL_OF_COLUMN StationFacts TABLES=STORED_TABLES
core.serial_line
    BAUDRATES LineFormat
core.states
    SafetyResult
guard.__main__
    _close_lease=close_lease _guard=guard_run _retry=retry_orders _take_over=take_over_run
    _watch=watch_recorder DEATH_S DYING_S READY=GUARD_READY TRIES=GUARD_TRIES
guard.action_log
    ActionLog close_stream LEAST_BYTES LINE_BYTES NAME=ACTION_LOG_FILE show=show_by_guard
    STDERR=GUARD_STDERR
guard.blind_orders
    BlindOrders
guard.continuity
    Continuity Hours is_mixed MOST_ORDERS ORDER_FOR_S Proof PROVEN_FOR_S why_left_alone
    why_unproven
guard.identifying
    identify=identify_for_guard NO_HOURS
guard.inquiry
    answer=answer_inquiry Inquiries Inquiry Unsafe
guard.lease
    guard_lock LOCK=LEASE_LOCK NAME=LEASES_FILE NEW=NEW_LEASES_FILE read_leases registered_runs
    runs_below StationLease write_leases
guard.lease_writer
    LeaseWriter
guard.open_leases
    close=close_leases IsRecording LeftOver Seen settle=settle_leases
guard.supervisor
    ANSWERED_AT_ONCE GuardProcess GuardSupervisor lease_of RunGuard TAKEN_OVER_S UNANSWERED_MOST
guard.takeover
    _open=open_for_guard OnceInThread OPENING TakeOver
guard.watch
    BEAT=WATCH_BEAT END=WATCH_END FAILED=WATCH_FAILED GRACE_S=WATCH_GRACE_S GuardLost
    HUNG_S=RECORDER_HUNG_S OVERSLEPT_S Recorder RENEW_S Verdict Watch
live
    Condition=LiveCondition Follower Phase=LivePhase RunState
live.view
    DISCONNECTED
maintenance.counter_totals.observed
    Count=CounterCount Observation Standing
maintenance.ledger
    add=add_to_counter_book auditing read_book=read_counter_book
maintenance.suspect_runs
    where_used
maintenance.verification
    Given keep=keep_verification own_of=own_verification
    verify=verify_tip
protocol.client.confirmed_reads
    ANSWERS=CONFIRMING_ANSWERS confirmed_value read_confirmed
protocol.client.dialogue
    LEAST_S least_s MOST_S QUIET_S=LINK_QUIET_S UNMEASURED_S
protocol.client.interface
    Client Contradiction expect_quiet FloodDetector LEAST_DUE MOST_TIMES PreparedRead
    QUIET_S=FLOOD_QUIET_S SUSPECT=SUSPECT_BYTES
protocol.client.make
    client_for
protocol.client.omega
    ALLOWED_S=OMEGA_ALLOWED_S COMPLETION_S GONE_S OmegaStation
protocol.client.robot
    Station
protocol.client.timing
    AnswerTime BACK_S change_address LEAST_ANSWERED LEAST_READS=LEAST_TIMED_READS
    MODEL=TIMED_READ NOT_ACKNOWLEDGED READS=TIMED_READS response_time ResponseTime restart
protocol.commands.command
    Command Effect Limits Scope
protocol.commands.defaults
    Default values_of=default_values
protocol.commands.error_tables
    COMMUNICATION_ERRORS
protocol.commands.family
    FAMILIES Family family_of OMEGA=OMEGA_PROTOCOL ROBOT=ROBOT_PROTOCOL
protocol.commands.hotair
    AIR_STATUS
protocol.commands.omega
    Cleaning ConditionNumber ConditionRecord difference=condition_difference
    differing=differing_conditions Digit is_condition OMEGA SetTemperature StoredCondition
    StoredRecord TRUE_ANSWERS WITHOUT_DIGIT
protocol.commands.plugged_hours
    can_be
protocol.commands.ranges
    longest_countdown_s odd_form range_problem
protocol.commands.signals
    ReadInterval
protocol.commands.status
    EXTRACTOR SOLDERING_STATUS STAND StatusWord WORKING
protocol.frame
    CorruptFrame Frame FrameReader LONGEST=LONGEST_FRAME MOST_HELD only_reads parse=parse_frame
    SHORTEST=SHORTEST_FRAME
protocol.omega
    encode=encode_omega LONGEST=LONGEST_OMEGA_FRAME MOST_HELD=MOST_HELD_OF_OMEGA OmegaReader
    only_reads=only_omega_reads sum_of=omega_sum_of
record.annotations
    Annotation append=append_annotation LONGEST=LONGEST_ANNOTATION NAME=ANNOTATIONS_FILE
    read=read_annotations
record.check
    check=check_run
record.clock_steps
    HostClock start_doubt
record.conclude
    left_leases NOT_KEPT
record.find_runs
    Filter=RunFilter find=find_runs Found=FoundRun
record.folder
    create_run DERIVED_TABLES
record.guard_actions
    ACTION_LOG=RECORDED_ACTION_LOG action_log=recorded_actions LEASE=RECORDED_LEASES
    LOCK=RECORDED_LOCK tidy=tidy_actions
record.ledger
    disagreements ledger_of SIGNALS=COUNTED_SIGNALS
record.manifest
    ClockStep LineFile Lost=RunLoss Manifest manifest_sha256 Metadata=RunMetadata read_manifest
    write_manifest
record.parts
    part_paths row_groups=row_groups_of
record.published
    Tree=PublishedTree
record.recover
    recover=recover_run
record.run_journal
    COMMIT_S=COMMIT_EVERY_S RunJournal=RunStore
record.schema
    SCHEMAS=STORED_SCHEMAS
record.segments
    SegmentWriter=StoreWriter
record.wire
    seal_capture
record.wire_recorder
    Head Keep=KeepCaptureRow WireRecorder
report.write
    write_report
session.discovery.diagnosis
    diagnose
session.discovery.scan_plan
    ADDRESSES=ALL_ADDRESSES LEARNING_S plan_for PortReport ScanPlan StationFound
    THOROUGH=THOROUGH_LINES Trial USUAL=USUAL_LINES
session.discovery.probe
    is_harmless question_text
session.manual.contact
    check_place Contact Target=ManualTarget
session.manual.danger
    Snapshot what_it_does
session.manual.names
    find=find_command is_order readable=readable_commands shared=shared_commands values_text
    writable=writable_commands
session.manual.read
    only_by_name read_all read_value ReadResult
session.manual.value_text
    shown=shown_value value_in words_for
session.manual.write
    write_value WriteOutcome WriteRequest WriteResult
session.setting_write
    Place WHOLE_STATION
session.rates
    IDENTITY_READS readings_for too_fast
session.run.context
    SessionContext
session.run.lateness
    SkippedTicks Standstill SUSPENDED_S
session.run.link_loss
    HOT_C
session.run.pace
    APART_S
session.run.port_rows
    HELD_S
session.run.readings
    fell_too_fast
session.run.reconnection
    FIRST_AFTER_FLOOD_S FIRST_SEEK_S FORGOTTEN_S LONGEST_AFTER_FLOOD_S LONGEST_SEEK_S
session.run.sampling
    FINISH_S
session.run.permit
    WRITES=RUN_WRITES
session.run.setting
    REPEATS=SETTING_REPEATS
session.run.state
    PortState
session.run.station_run
    run_station
session.run.task
    StationTask
session.safety.blind
    blind_word
session.safety.cooling
    _cools=heat_falls _Heat=HeatReading is_cold=tool_is_cold
session.safety.secure
    ALLOWED_S=SECURE_ALLOWED_S LOOK_S secure
session.safety.time_budget
    in_time TimeBudget
session.safety.tools
    SafetyTask ToolSafety
session.scheduler
    AUTO_RATES_HZ CEILING=SLOW_CEILING Demand Grid read_wire_s ScheduledRead SlowReadings
sim.build
    build_device MODELS
sim.device
    AcceptedWrite
sim.faults
    OF_OMEGA=OMEGA_FAULTS
sim.hotair
    AirPlant=AirModel AirStation
sim.links
    heard line_set
sim.omega
    KINDS=OMEGA_FAULT_KINDS
sim.port
    HIBERNATION=SIM_HIBERNATION NO_TOOL=SIM_NO_TOOL SimPort SLEEP=SIM_SLEEP STAND=SIM_STAND
    WORKING=SIM_WORKING
sim.process
    SimProcess
sim.serve
    ByteLog Server=SimServer
sim.setup
    SERVED_LINE set_up=set_up_sim virtual_station
sim.plant
    questions=sim_questions
sim.soldering
    SolderingPlant=SolderingModel
sim.virtual
    Reply VirtualOmega VirtualStation
transport.cpu_limit
    cpu_limit
transport.device
    PortDevice
transport.opening
    allow_ports BESIDE EACH_PORT make_ready open_port
transport.port
    BROKEN=PORT_BROKEN close_in_thread CLOSE_S DescriptorPort greeting_text MOST_AT_ONCE
    ObjectPort Port
transport.read_only
    ReadOnly
transport.rfc2217
    MOST_WAITING
transport.session_history
    captured=captured_steps Divergence replayed=replayed_steps ReplayStep
transport.start_barrier
    SILENT_S
transport.system_ports
    holder_of process_text
transport.virtual
    Peer VirtualDriver
"""

PATCHED: Mapping[str, str] = {
    "ActionLog._write": "guard.action_log.ActionLog._write",
    "AirModel.allowed": "sim.hotair.AirPlant.allowed",
    "AirStation.suck": "sim.hotair.AirStation.suck",
    "RunGuard.start": "guard.supervisor.RunGuard.start",
    "RunStore._write_loop": "record.run_journal.RunJournal._write_loop",
    "SimPort.order": "sim.port.SimPort.order",
    "StoreWriter.add": "record.segments.SegmentWriter.commit",
    "SystemClock.monotonic": "core.clock.SystemClock.monotonic",
    "SystemClock.utc": "core.clock.SystemClock.utc",
    "action_log.STDERR": "guard.action_log.STDERR",
    "audit_records.LAG": "app.audit.records.LAG",
    "capture_recorder.LEAST_FREE": "record.wire_recorder.LEAST_FREE",
    "clock.elapsed": "core.clock.elapsed",
    "connection.run_that_holds": "app.connection.run_that_holds",
    "cooling._heat": "session.safety.cooling._heat",
    "dialogue.LEAST_S": "protocol.client.dialogue.LEAST_S",
    "dialogue.MOST_S": "protocol.client.dialogue.MOST_S",
    "dialogue.UNMEASURED_S": "protocol.client.dialogue.UNMEASURED_S",
    "guard.RETRY_EVERY_S": "guard.__main__.RETRY_EVERY_S",
    "guard.RETRY_FOR_S": "guard.__main__.RETRY_FOR_S",
    "guard.STDIN": "guard.__main__.STDIN",
    "guard.STDOUT": "guard.__main__.STDOUT",
    "guard.TakeOver": "guard.__main__.TakeOver",
    "guard.WRITE_S": "guard.__main__.WRITE_S",
    "guard._take_over": "guard.__main__._take_over",
    "guard._watch": "guard.__main__._watch",
    "guard.guard_lock": "guard.__main__.guard_lock",
    "guard.show": "guard.__main__.show",
    "lease.write_leases": "guard.lease.write_leases",
    "open_leases.PATIENCE_S": "guard.open_leases.PATIENCE_S",
    "open_leases.RETRY_S": "guard.open_leases.RETRY_S",
    "open_leases.SETTLE_S": "guard.open_leases.SETTLE_S",
    "open_leases._settle": "guard.open_leases._settle",
    "open_leases._take_over": "guard.open_leases._take_over",
    "open_leases.guard_lock": "guard.open_leases.guard_lock",
    "opening.DescriptorPort": "transport.opening.DescriptorPort",
    "opening._keep_others_out": "transport.opening._keep_others_out",
    "port_owner.holds": "record.port_owner.holds",
    "port_owner.runs_that_hold": "record.port_owner.runs_that_hold",
    "read.EVERY_S": "session.manual.read.EVERY_S",
    "recorder.run_station": "app.run.recorder.run_station",
    "report.gather": "report.write.gather",
    "run_record.seal_in_child": "app.run.run_record.seal_in_child",
    "safe_state.COLD_EVERY_S": "app.safe_state.COLD_EVERY_S",
    "safe_state.COLD_WITHIN_S": "app.safe_state.COLD_WITHIN_S",
    "safe_state.CONNECT_S": "app.safe_state.CONNECT_S",
    "safe_state.TERM_S": "app.safe_state.TERM_S",
    "secure.ALLOWED_S": "session.safety.secure.ALLOWED_S",
    "store.RESERVE_BYTES": "record.segments.RESERVE_BYTES",
    "supervisor.END_S": "guard.supervisor.END_S",
    "supervisor.GuardProcess": "guard.supervisor.GuardProcess",
    "supervisor.READY_S": "guard.supervisor.READY_S",
    "supervisor.subprocess": "guard.supervisor.subprocess",
    "survey._open": "app.audit.survey._open",
    "survey.run_that_holds": "app.audit.survey.run_that_holds",
    "takeover.BEGUN_S": "guard.takeover.BEGUN_S",
    "takeover._open": "guard.takeover._open",
    "takeover.blocking.run": "transport.blocking.run",
    "takeover.secure": "guard.takeover.secure",
    "takeover.show": "guard.takeover.show",
}
"""What tests replace, and where it stands."""


def _places(table: str) -> dict[str, tuple[str, str]]:
    """Name for tests -> module, and its name there."""
    places: dict[str, tuple[str, str]] = {}
    module = ""
    for line in table.splitlines():
        if not line.startswith(" "):
            module = line.strip()
            continue
        for entry in line.split():
            name, _, other = entry.partition("=")
            assert (other or name) not in places, entry
            places[other or name] = (module, name)
    return places


PLACES = _places(NAMES)


def __getattr__(name: str) -> Any:
    if name == "package":
        return import_module("jbclog")
    if name not in PLACES:
        raise AttributeError(f"{name} is not in the list of support/product.py")
    module, own = PLACES[name]
    return getattr(import_module(f"jbclog.{module}"), own)


def put(name: str, value: object) -> None:
    """Replace something of `PATCHED` for the rest of the process."""
    place, _, own = PATCHED[name].rpartition(".")
    setattr(resolve_name(f"jbclog.{place}"), own, value)


def patch(monkeypatch: pytest.MonkeyPatch, name: str, value: object) -> None:
    """Replace something of `PATCHED` for the rest of the test."""
    monkeypatch.setattr(f"jbclog.{PATCHED[name]}", value)


# -- sessions --------------------------------------------------------------------------------------


class Session:
    """The session of one station: what a test gives it, and what it can see of it."""

    def __init__(self, order: StationTask, journal: Journal, clock: Clock) -> None:
        from jbclog.core.clock import UtcOffset
        from jbclog.session.run.context import SessionContext

        self._context: SessionContext = SessionContext.of(order, journal, UtcOffset(clock))

    def steps(self) -> Steps[StationFacts]:
        """Return the whole run of the station, for a driver."""
        from jbclog.session.run.station_run import run_station

        return run_station(self._context)

    @property
    def name(self) -> str:
        return self._context.name

    @property
    def order(self) -> StationTask:
        return self._context.order

    @property
    def recipe(self) -> Recipe:
        return self._context.order.recipe

    @property
    def utc(self) -> UtcOffset:
        return self._context.log.utc

    @property
    def family(self) -> Family:
        return self._context.state.family

    @property
    def step(self) -> int:
        """Step of the start that the station has reached."""
        return self._context.state.step

    @property
    def facts(self) -> StationFacts:
        return self._context.state.facts

    @property
    def ports(self) -> dict[int, PortState]:
        return self._context.state.ports

    @property
    def journal(self) -> Journal:
        return self._context.log.journal

    @journal.setter
    def journal(self, journal: Journal) -> None:
        self._context.log.journal = journal

    def command(self, name: str) -> Command:
        return self._context.command(name)

    def count_readings(self, port: int) -> ReadingCount:
        """Return the readings due and obtained so far, as shown."""
        return self._context.state.count_readings(port)

    def listed_writes(self) -> Permit:
        """Return the check before each write, which raises for anything that is not listed."""
        from jbclog.session.run.permit import WritePermit

        return WritePermit(self._context)

    def choose_pace(self) -> SamplingPlan:
        """Return when the ticks are due, or raise if the link is too slow for the rate."""
        from jbclog.session.run.pace import choose_pace

        return choose_pace(self._context)


def _reconnection(desk: Any) -> Reconnection:
    """Return the pauses of a desk, on which a test has all that a loss concerns of a session."""
    from jbclog.session.run.reconnection import Reconnection

    kept: Reconnection = vars(desk).setdefault("reconnection", Reconnection())
    return kept


def _with_desk(desk: Any) -> Any:
    _reconnection(desk)
    return SimpleNamespace(state=desk, log=desk, now=desk.now)


def report_loss(desk: Any, cause: LinkError | StationError) -> None:
    from jbclog.session.run import link_loss

    link_loss.report_loss(_with_desk(desk), cause)


def report_flood(desk: Any, flood: LinkFlooded) -> None:
    from jbclog.session.run import link_loss

    link_loss.report_flood(_with_desk(desk), flood)


def note_flood_over(desk: Any) -> None:
    _reconnection(desk).end_flood(desk.now)


def first_pause_s(desk: Any) -> float:
    return _reconnection(desk).first_pause_s()


def next_pause_s(desk: Any, pause_s: float) -> float:
    return _reconnection(desk).next_pause_s(pause_s)


def pull(steps: Steps[T]) -> Request:
    """Begin; return the first request."""
    return steps.send(None)


def send(steps: Steps[T], result: IoResult) -> Request:
    """Go on with the result of a request; return the next one."""
    return steps.send(result)


def throw(steps: Steps[T], error: BaseException) -> Request:
    """Let a request fail; return the next one."""
    return steps.throw(error)


def before_each_value(monkeypatch: pytest.MonkeyPatch, call: Callable[[], None]) -> None:
    """Call before a value is put into its row, for the rest of the test."""
    from jbclog.session.run import row_values, signal_read

    fill_of = signal_read.fill_of

    def watched(read: ScheduledRead, state: StationState) -> row_values.Fill:
        fill = fill_of(read, state)

        def fill_watched(row: SampleRow, value: Value) -> None:
            call()
            fill(row, value)

        return fill_watched

    monkeypatch.setattr(signal_read, "fill_of", watched)


def before_made_safe(monkeypatch: pytest.MonkeyPatch, call: Callable[[str], None]) -> None:
    """Call with the station's name before its tools are made safe, for the rest of the test."""
    from jbclog.session.run import station_run

    make_safe = station_run.make_safe

    def watched(context: SessionContext) -> Steps[None]:
        call(context.name)
        return make_safe(context)

    monkeypatch.setattr(station_run, "make_safe", watched)


def write_before_sampling(
    monkeypatch: pytest.MonkeyPatch, name: str, value: object, port: int | None, tool: int | None
) -> None:
    """Let each session write something that nobody asked for, between start and first tick."""
    from jbclog.session.run import station_run

    read_counters = station_run.read_counters

    async def broken(context: SessionContext) -> None:
        await read_counters(context)
        if context.state.facts.first_tick is None:
            await context.station.write(context.command(name), value, port, tool)  # type: ignore[arg-type]

    monkeypatch.setattr(station_run, "read_counters", broken)


# -- clients and ports -----------------------------------------------------------------------------


def note_answered(station: OmegaStation, letter: str) -> None:
    """Let a controller have answered this question before."""
    station._answered.add(letter)


def bytes_waiting(port: ObjectPort) -> int:
    """Return how many bytes have come to a port's object and were not read."""
    assert port._opened is not None
    waiting: int = port._opened.in_waiting  # type: ignore[attr-defined]
    return waiting


# -- programs of other processes -------------------------------------------------------------------

MAIN = "from jbclog.cli import main; main()"
"""The command `jbclog`."""

# A guard ends a recorder that is silent for two seconds, and waits a second for its disk. In a test
# the recorder is the program of the tests, which a busy machine may keep for longer.
PATIENT_GUARD = """
import runpy
from jbclog.guard import lease_writer, watch
watch.HUNG_S = 600.0
settle = lease_writer.LeaseWriter.settle
lease_writer.LeaseWriter.settle = lambda writer, _: settle(writer, 600.0)
runpy.run_module("jbclog.guard", run_name="__main__", alter_sys=True)
"""
"""The program of a guard that waits ten minutes for a silent recorder, and for a slow disk."""

IMPATIENT_GUARD = """
import sys
from jbclog.guard import __main__ as guard
from jbclog.session.safety import secure
guard.RETRY_EVERY_S, secure.ALLOWED_S = 0.1, 1.5
sys.exit(guard.main())
"""
"""The program of a guard that soon tries again, and soon gives up."""

RECORDER_THAT_DIES = """
import os, signal, subprocess, sys, time
from pathlib import Path
from jbclog.guard.lease import StationLease
from jbclog.guard.supervisor import GuardSupervisor
guards = GuardSupervisor(Path(sys.argv[1]), lambda *_: None)
guards.lease(StationLease.from_json(sys.stdin.readline()))
started = subprocess.Popen.__init__

def start_and_die(*arguments, **options):
    started(*arguments, **options)
    os.kill(os.getpid(), signal.SIGKILL)

subprocess.Popen.__init__ = start_and_die
os.kill(guards.pid, int(sys.argv[2]))
while True:
    guards.renew()
    time.sleep(0.1)
"""
"""A recorder: its guard gets a signal, and it dies itself as soon as the next guard is there."""

GUARD_PROCESS = b"jbclog.guard"
"""The module that a guard's process runs, as it stands in its command."""

IMPORT_GUARD = "import jbclog.guard.__main__"
"""Loads what a guard's process loads."""

SEALING_PROCESS = b"jbclog.record.seal"
"""The same of the process that seals."""

SETTLES_SLOWLY = """
import time, pathlib, jbclog.app.run.recorder as recorder
settle, there = recorder.settle, pathlib.Path({there!r})
recorder.settle = lambda *given: there.touch() or time.sleep(1.0) or settle(*given)
from jbclog.cli import main; main()
"""
"""The command; a second long it deals with what older runs left, once the file {there} is made."""

LOOKS_AT_PORTS_OFTEN = """
import jbclog.app.run.recorder as recorder
recorder.LOOK_AT_PORTS_EVERY_S = 0.5
from jbclog.cli import main; main()
"""
"""The command; a run looks twice a second for others that have its ports open."""

SHOWING_FAILS = """
import jbclog.cli.progress as progress
def fail(*_): raise ValueError("a fault of its own")
for name in ("begun", "happened", "second", "sealing", "close"):
    assert callable(getattr(progress.Lines, name))
    setattr(progress.Lines, name, fail)
from jbclog.cli import main; main()
"""
"""The command; whatever shows a run fails."""

GUARD_DOES_NOT_START = """
import shutil, types
from jbclog.cli import main
from jbclog.guard import supervisor
supervisor.sys = types.SimpleNamespace(executable=shutil.which("false"))
main()
"""
"""The command; a guard's process ends at once."""

HALF_AN_EXPORT = """
import sys, time
from pathlib import Path
from jbclog.app.export.place import written
with written(Path(sys.argv[1])) as aside:
    aside.write_text("half")
    print("written", flush=True)
    time.sleep(60)
"""
"""Writes half of an export and says so; ends after a minute."""

LEASES_SEEN_BY_USER = """
import json, os, sys
from pathlib import Path
from jbclog.app.doctor import look_at_lease_list
from jbclog.guard.lease import StationLease, listing, registered_runs, write_leases
from jbclog.guard.open_leases import about_list

folder, user = Path(sys.argv[1]), int(sys.argv[2])
os.setgid(user)
os.setuid(user)
found = listing(folder)
lease = StationLease("a", "/dev/ttyX", 19200, "8N1", 1, "dde", "DDE", "1", "stand", (1,), False)
write_leases(folder, [lease])
there = [str(run) for run in registered_runs().there]
write_leases(folder, [])
looked = look_at_lease_list(folder)
print(json.dumps({
    "registry": None if found.registry is None else str(found.registry),
    "why": list(found.why_not),
    "there": there,
    "closed": registered_runs() == ([], []),
    "left": [] if found.registry is None else os.listdir(found.registry),
    "about": about_list(folder),
    "looked": [type(looked).__name__, looked.kind, looked.what, getattr(looked, "step", "")],
}))
"""
"""What the user of a number sees who writes a lease of a run in a folder, as JSON."""

STOPPED_FOLLOWER = """
import os, signal, sys
from jbclog.live import follow, segment_cursor
plain = segment_cursor.read_items
def stopping(*segment):
    print("reading", flush=True)
    os.kill(os.getpid(), signal.SIGSTOP)
    return plain(*segment)
segment_cursor.read_items = stopping
follow(sys.argv[1]).poll()
"""
"""Follows a run, and is stopped in the middle of its first read; says so before."""

HOLD_PORT = """
import sys
from jbclog.transport.opening import open_port
from jbclog.core.serial_line import LineFormat
port = open_port(sys.argv[1], LineFormat())
print("held", flush=True)
sys.stdin.read()
"""
"""Opens a port and holds it until its input ends."""

LOCKS_WITHOUT_POSIX = """
import os
import threading
from pathlib import Path

from jbclog.core import operating_system as system
from jbclog.core.durable_files import write_new, write_whole
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind
from jbclog.core.line_file import LineFile
from jbclog.core.locks import FolderLock, is_held, try_lock

path = Path("locked")
path.write_bytes(b"0123456789")
first, second = (os.open(path, os.O_RDWR) for _ in range(2))
os.lseek(first, 3, os.SEEK_SET)
assert system.read_at(first, 4, 5) == b"5678"
assert system.write_at(first, b"xy", 8) == 2
assert os.read(first, 9) == b"34567xy"
system.lock_exclusive(first)
for lock in (system.lock_exclusive, system.lock_shared):
    try:
        lock(second)
    except PermissionError:
        continue
    raise AssertionError(lock)
assert os.read(second, 4) == b"0123"
assert os.lseek(second, 0, os.SEEK_CUR) == 4
assert try_lock(path) is None
threading.Timer(0.2, os.close, [first]).start()
system.wait_for_lock(second)
os.close(second)

folder = Path("taken")
folder.mkdir()
lock = FolderLock.take(folder)
assert is_held(folder)
try:
    FolderLock.take(folder, 0.1)
except RecordError as error:
    assert f"process {os.getpid()}" in str(error)
lock.release()
assert not is_held(folder)
write_whole(folder / "whole", b"1")
write_new(folder / "new", b"2")
lines = LineFile(folder / "lines", Kind.LEDGER)
lines.reserve(100)
lines.append_line(b"1")
lines.append_line(b"2")
lines.release()
assert lines.lines_since(2) == ([b"2"], 4)
assert system.limit_bytes() is None
assert system.processes() == list(system.open_files(os.getpid())) == []
system.lower_priority(10)
print("fine")
"""
"""Tries locks, files and processes of the package without POSIX; says that it is fine."""

SERVED_PAGE = """
import threading
import urllib.request
from pathlib import Path

from jbclog.app.watch.batch_queue import QueueFollower
from jbclog.app.watch.server import Access, PageServer, listening
from jbclog.live import follow

run = Path("run")
with listening("127.0.0.1", 0) as opened, follow(run, joints=True) as follower:
    access = Access("127.0.0.1", None)
    server = PageServer(follower.poll, access, run, QueueFollower(run).poll)

    def read():
        with urllib.request.urlopen(f"http://127.0.0.1:{opened.getsockname()[1]}/") as page:
            print(page.status)
        server.should_exit = True

    reader = threading.Thread(target=read)
    reader.start()
    server.run([opened])
    reader.join()
"""
"""Serves the page of a run in the folder `run` once; tells the status."""

INTERRUPTED_SIM = """
import signal, threading, time
from jbclog.sim.links import Waiter
from jbclog.sim.serve import Server
server = Server([], Waiter())
server.stop_on_signals()
def take():
    time.sleep(0.3)
    signal.pthread_kill(threading.get_ident(), signal.SIGTERM)
threading.Thread(target=take).start()
server.run()
"""
"""Serves nothing; a thread that does not wait takes SIGTERM."""

SIM_OF_DYING_PARENT = """
import os, sys
from pathlib import Path
from jbclog.sim.process import SimProcess
sim = SimProcess(Path(sys.argv[1]), Path(sys.argv[2])).__enter__()
print(sim.pid, flush=True)
os.kill(os.getpid(), 9)
"""
"""Serves a line from a child process, tells its number, and is killed."""


# -- what is loaded --------------------------------------------------------------------------------

LOADED_BY_HELP = frozenset({"cli", "cli.front_page", "cli.streams"})
"""The package's modules that `jbclog --help` loads."""

LOADED_TO_RECORD = frozenset(
    {"jbclog.session.run.station_run", "jbclog.analysis.verdict.verdict", "pyarrow.lib"}
)
"""Some of what a recorder must load: where these are not seen, nobody has looked."""

NOT_LOADED_TO_RECORD = (
    "jbclog.analysis.joints",
    "jbclog.analysis.run",
    "jbclog.report",
    "jbclog.sim",
)
"""What of the package a recorder has no use for."""


# -- a run in progress -----------------------------------------------------------------------------

REFUSED_WITHOUT_INODES = (
    (9, "{folder}/live.lock cannot be opened"),
    (10, "{folder}: no record can be written there"),  # the reserve
    (11, "{folder}: no record can be written there"),  # the first segment
)
"""Inodes that are not enough to open the store of a run in, with what is said of it."""

_OPEN_STORES: WeakValueDictionary[Path, RunJournal] = WeakValueDictionary()


def open_store(
    folder: Path, on_failure: Callable[[RecordError], None] | None = None, **options: Any
) -> RunJournal:
    """Return the store that writes the rows of a run in progress. It calls `on_failure` once, when
    the record is not whole.
    """
    from jbclog.record.run_journal import RunJournal

    store = RunJournal(folder, on_failure, **options)
    _OPEN_STORES[folder] = store
    return store


def names_of_open_run(folder: Path) -> list[str]:
    """Return the names of the files that a run in progress has for its rows."""
    return sorted(path.name for path in folder.glob("live-*.journal"))


def files_of_rows(folder: Path) -> list[Path]:
    """Return the files that hold the rows of a run in progress, in the order of writing."""
    from jbclog.record.segments import segments

    return segments(folder)


def committed_samples(folder: Path) -> int:
    """Return how many rows of samples a run in progress has committed, and not sealed. None of them
    is read.
    """
    return sum(
        frame.rows
        for path in files_of_rows(folder)
        for commit in _commits_with(path, "samples")
        for frame in _frames_of(commit, "samples")
    )


def _commits_with(path: Path, table: str) -> list[Commit]:
    """Return the commits in a file that have rows of a table; none if it was sealed meanwhile."""
    from jbclog.record.frames import Commit, read_items

    try:
        with path.open("rb") as file:
            commits = [item for item in read_items(file) if isinstance(item, Commit)]
    except FileNotFoundError:
        return []
    return [commit for commit in commits if _frames_of(commit, table)]


def _frames_of(commit: Commit, table: str) -> list[Frame]:
    from jbclog.core.rows import TABLES
    from jbclog.record.frames import FrameKind

    return [
        frame
        for frame in commit.frames
        if frame.kind is FrameKind.ROWS and frame.table == TABLES.index(table)
    ]


def bytes_kept_for_readers(folder: Path) -> int:
    """Return how many bytes a run in progress keeps, beside its rows, because somebody reads: those
    of files that were removed while a process had them open.
    """
    sizes: dict[str, int] = {}
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with suppress(OSError):  # closed meanwhile, or of another user
            name = str(link.readlink())
            if name.startswith(f"{folder}/live-") and name.endswith(" (deleted)"):
                sizes[name] = link.stat().st_size
    return sum(sizes.values())


def before_each_write(call: Callable[[], None]) -> None:
    """Call before whatever the store of a run in progress does on its disk, in this process from
    now on.
    """
    from jbclog.record.segments import Disk

    def watched(operation: Callable[..., Any]) -> Callable[..., Any]:
        def operate(*arguments: Any) -> Any:
            call()
            return operation(*arguments)

        return operate

    for name in ("create", "write", "sync", "truncate"):
        setattr(Disk, name, watched(getattr(Disk, name)))


def fail_next_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the next commit of rows fail as where a disk cannot be written. Undoes all of
    `monkeypatch` then.
    """
    import errno

    from jbclog.record.segments import Disk

    def fails(disk: Disk, file: int) -> None:
        monkeypatch.undo()
        raise OSError(errno.EIO, "made up")

    monkeypatch.setattr(Disk, "sync", fails)


def lose_commit(folder: Path, table: str, place: int) -> None:
    """Damage the commit number `place` of those that have rows of a table in an open run, from
    0.
    """
    (path,) = files_of_rows(folder)
    commit = _commits_with(path, table)[place]
    data = bytearray(path.read_bytes())
    data[commit.end - 1] ^= 1
    path.write_bytes(data)


def seal(folder: Path) -> None:
    """Seal the rows of a run that has ended, in this process."""
    from jbclog.record.seal import seal_journal

    seal_journal(folder)


def seal_part(folder: Path) -> None:
    """Seal the rows that a run in progress has so far, as once an hour."""
    from jbclog.record.seal import seal_journal

    _begin_segment(folder)
    seal_journal(folder, is_open=True)


def _begin_segment(folder: Path) -> None:
    """Let the store of an open run begin a new segment; without one, add it as its store would."""
    import json

    from jbclog.record.journal_reader import Journal
    from jbclog.record.segments import SegmentWriter, segment_number

    now_us = time.time_ns() // 1000
    store = _OPEN_STORES.get(folder)
    if store is not None and store._writer._file is not None:
        with store._committing:
            store._writer.rotate(now_us)
        return
    writer = SegmentWriter(folder)
    with Journal(folder) as journal:
        writer._begun = 1 + max(segment_number(path) or 0 for path in journal.paths)
        writer._facts = {name: json.dumps(facts) for name, facts in journal.facts.items()}
        writer._notes = dict(journal.notes)
        mark = journal.last_mark
        writer.commits = mark.number if mark else 0
    writer.rotate(now_us)
    writer.close()


def seal_as_hourly(record: RunRecord) -> None:
    """Commit what a run has, let a process seal it as once an hour, and wait for it."""
    store = record._store
    store.commit_now()
    store.seal_now()
    end = time.monotonic() + 60
    while store._child and time.monotonic() < end:
        time.sleep(0.05)


def conclude_run(
    folder: Path, manifest: Manifest | None = None, lock: FolderLock | None = None
) -> None:
    """Write the manifest of a run whose rows are sealed, as at the end of a run: the one that is
    there, under a lock of its own, where they are not given.
    """
    from jbclog.core.locks import FolderLock
    from jbclog.record.conclude import conclude
    from jbclog.record.manifest import read_manifest

    conclude(folder, manifest or read_manifest(folder), lock or FolderLock.take(folder))


# -- a capture -------------------------------------------------------------------------------------

ANOTHER_REQUEST = "it would gather; recorded is ask"
"""Said of a session that waits for something, where the capture has a question."""


def captured_rows(folder: Path, station: str) -> list[CaptureRow]:
    """Return what a run's capture has of a station, up to the first row that is missing."""
    from jbclog.record.wire import captured_rows as rows_of

    return list(rows_of(folder, station))


def rows_of_capture(path: Path) -> list[CaptureRow]:
    """Return the rows of all stations in a file of a capture."""
    from jbclog.record.parts import groups_of
    from jbclog.record.wire import rows_in

    return [row for group in groups_of([path]) for row in rows_in(group)]


def wire_paths(folder: Path) -> list[Path]:
    """Return the files of a run's capture."""
    from jbclog.record.parts import part_paths
    from jbclog.record.schema import CAPTURE

    return part_paths(folder, CAPTURE)


def is_capture_done(path: Path) -> bool:
    """Return True if nothing is missing in the capture of which this is a file."""
    from jbclog.record.wire import losses

    return not losses(path.parent.parent)


def bytes_of_capture(folder: Path, station: str) -> int:
    """Return the size of a run's capture, of which `station` is the only one."""
    return sum(path.stat().st_size for path in wire_paths(folder))


def cut_capture(folder: Path, station: str, share: float) -> None:
    """Leave the first `share` of a capture, of which `station` is the only one."""
    import pyarrow.parquet as pq

    (path,) = wire_paths(folder)
    rows = pq.ParquetFile(path).read()
    pq.write_table(rows.slice(0, int(rows.num_rows * share)), path)


def reproduction(folder: Path, out: Path) -> list[str | Path]:
    """Return the words of the command that lives through a captured run again."""
    return ["check", folder, "--from-capture"]


def measure_less(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let sessions measure the response time with two reads less, for the rest of the test."""
    from jbclog.protocol.client import timing
    from jbclog.session.run import pace

    monkeypatch.setattr(timing, "READS", timing.READS - 2)
    monkeypatch.setattr(timing, "LEAST_READS", timing.LEAST_READS - 2)
    monkeypatch.setattr(pace, "LEAST_ANSWERED", pace.LEAST_ANSWERED - 2)


# -- alarms ----------------------------------------------------------------------------------------


def evaluated_alarms(
    facts: StationFacts,
    settings: Iterable[SettingRow],
    events: Iterable[EventRow],
    samples: Iterable[SampleRow],
) -> tuple[list[EventRow], list[bool]]:
    """Return the events that the recorder's evaluation adds to a run, and of each tool whether it
    has come to its setting.
    """
    from jbclog.analysis.alarms.live import LiveAlarms

    added: list[EventRow] = []
    alarms = LiveAlarms(added.append)
    alarms.facts(facts)
    for setting in settings:
        alarms.setting(setting)
    for event in events:
        alarms.event(event)
    for sample in samples:
        alarms.sample(sample)
    return added, [watch._arrival.has_arrived for watch in alarms._watches.values()]


# -- contradictions of the manuals -----------------------------------------------------------------


@dataclass(frozen=True)
class ManualContradiction:
    """A row of docs/reference/contradictions.md; `number` without its ``B-``."""

    number: int
    title: str
    reading: str
    reason: str
    quirks: tuple[str, ...]
    """Names of the alternatives that virtual stations can play."""
    met: str
    """Text of the event with which a run reports it; empty where no run can meet it."""
    doubtful: bool
    usual: bool


def contradictions() -> dict[int, ManualContradiction]:
    """Return all of them, by number."""
    from jbclog.protocol.commands.decisions import decisions

    return {
        number: ManualContradiction(
            one.number,
            one.title,
            one.reading,
            one.reason,
            one.quirks,
            one.met,
            one.doubtful,
            one.usual,
        )
        for number, one in decisions().items()
    }


def robot_quirks() -> dict[str, int]:
    """Return what virtual stations with JBC's protocol can play, and of which contradiction."""
    from jbclog.sim.quirks import QUIRKS

    return {name: quirk.number for name, quirk in QUIRKS.items()}


def omega_quirks() -> dict[str, int]:
    """Return what virtual OMEGA controllers can play, and of which contradiction."""
    from jbclog.sim.omega import OMEGA_QUIRKS

    return dict(OMEGA_QUIRKS)


def tolerated() -> list[tuple[str, int]]:
    """Return each command whose data or acknowledgement may have a form beside the recommended
    one, with the contradiction that says so.
    """
    from jbclog.protocol.commands import ranges

    found = [(command, form.number) for command, form in ranges.ODD_FORMS.items()]
    for answered in (ranges.READ_ANSWERED_AS, ranges.WRITE_ANSWERED_AS):
        found += [(command, number) for command, (number, _) in answered.items()]
    found += ranges.ACKNOWLEDGED_WITH_VALUE.items()
    found += ranges.WITHOUT_DATA.items()
    return found


# -- figures that pages state ----------------------------------------------------------------------


def false_alarms(*, all_tests: bool) -> tuple[float, float, float]:
    """Return what charts say of their false alarms: signals in 100 points, points to the first
    signal, share of series of 100 points with a signal.
    """
    from jbclog.analysis.spc.nelson import ALL_TESTS, DEFAULT_TESTS, FALSE_ALARMS

    stated = FALSE_ALARMS[ALL_TESTS if all_tests else DEFAULT_TESTS]
    return stated.per_100, stated.run_length, stated.series


def counted_in(book: Path) -> dict[tuple[str, str], dict[Any, tuple[int, int, Any]]]:
    """Return what a book of counters says, by line and station, then by counter: the first look and
    the last one, and the interval that holds what was counted between them.
    """
    from jbclog.maintenance.counter_totals.history import histories
    from jbclog.maintenance.counter_totals.tracing import traces_of
    from jbclog.maintenance.ledger import read_book

    return {
        place: {
            key: (trace.points[0].look, trace.points[-1].look, trace.counter_total.total)
            for key, trace in traces_of(history).now.items()
        }
        for place, history in histories(read_book(book).entries).items()
    }


def read_verification_book(out: Path) -> Any:
    """Return the verifications in the folder of runs `out`, as `all`."""
    from jbclog.maintenance.verification import read_book

    return SimpleNamespace(all=read_book(out).entries)
