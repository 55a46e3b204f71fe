"""A batch's journal on disk: cut off anywhere, changed anywhere, held by another, asked to go on with what is not the same."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.app.batch.executor import Timing
from jbclog.app.batch.job_dir import JobDir
from jbclog.app.batch.job_spec import BatchPlan, plan_batch
from jbclog.app.batch.journal import NAME, Journal, begin, home_of, newest, read
from jbclog.app.batch.processes import result_of
from jbclog.app.batch.resume import PreparedBatch, prepare
from jbclog.app.batch.single_batch import hold
from jbclog.app.batch.state import Entry, Kind, batch_state
from jbclog.config.job_order import SystemZone
from jbclog.config.jobs_file import load_jobs
from jbclog.core.errors import JbclogError, Problems, RecordError, UsageError
from support.command import BENCH, PROFILES

NIGHT = 1_790_000_000.0
RECIPE = PROFILES / "recipes" / "sac305-smd.toml"
MEANS = Timing(lambda: NIGHT, lambda: None)
SITTING = Entry("", Kind.EXECUTION, "The batch begins.")
START = Entry("", Kind.START, "a is started.", "a", 1)
END = Entry("", Kind.END, "", "a", 1, "done", False, 0, "ACCEPT", "run-1")
FINISH = Entry("", Kind.FINISH, "Every job has come to its end.")
TEXT = f"""[batch]
line = "{BENCH}"
[[job]]
name = "a"
recipe = "{RECIPE}"
stations = ["dde-1"]
duration = "15m"
rate = "fit"
[[job]]
name = "b"
recipe = "{RECIPE}"
stations = ["dde-2"]
duration = "15m"
rate = "fit"
"""


class Bench:
    """A jobs file, and the batches that were made of it."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "night.toml"
        self.out = folder / "runs"
        self.file.write_text(TEXT)
        self.home = home_of(self.out, self.file)
        self.home.mkdir(parents=True)

    def plan(self) -> BatchPlan:
        return plan_batch(load_jobs(self.file), self.out)

    def take(self, *, resume: bool = False, anew: bool = False) -> PreparedBatch:
        return prepare(self.plan(), self.out, MEANS, SystemZone(), resume=resume, anew=anew)

    def change(self, before: str, after: str) -> None:
        assert before in TEXT
        self.file.write_text(TEXT.replace(before, after))

    def problems(self, **how: bool) -> str:
        with pytest.raises(UsageError) as raised:
            self.take(**how)
        return str(raised.value)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def interrupted(bench: Bench) -> Journal:
    journal = bench.take().journal
    journal.note(SITTING)
    journal.note(START)
    return journal


# -- what a crash leaves -------------------------------------------------------------------------------------------------------


def test_cut_off_at_every_byte_it_says_what_was_acknowledged_before(tmp_path: Path) -> None:
    journal = begin(tmp_path, TEXT, MEANS.utc)
    for entry in (Entry("", Kind.BEGIN, ""), replace(START, kind=Kind.JOB), SITTING, START, END, FINISH):
        journal.note(entry)
    path = journal.folder / NAME
    whole, entries = path.read_bytes(), read(journal.folder)
    ends = [place for place, byte in enumerate(whole) if byte == ord("\n")]
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        count = sum(end <= length for end in ends)  # a line that lacks nothing but its end has lost nothing
        assert read(journal.folder) == entries[:count]
    path.write_bytes(whole)
    assert read(journal.folder) == entries


def test_what_is_written_behind_a_line_that_was_cut_off_goes_on_with_the_chain(tmp_path: Path) -> None:
    journal = begin(tmp_path, TEXT, MEANS.utc)
    for entry in (Entry("", Kind.BEGIN, ""), SITTING, START):
        journal.note(entry)
    path = journal.folder / NAME
    path.write_bytes(path.read_bytes()[:-20])
    again = newest(tmp_path, MEANS.utc)
    assert again is not None
    again.note(replace(START, attempt=1))
    assert [entry.kind for entry in read(journal.folder)] == ["begin", "sitting", "start"]
    assert batch_state(read(journal.folder)).jobs["a"].state.value == "running"


@pytest.mark.parametrize(
    "change", [lambda data: data.replace(b"a is started", b"b is started"), lambda data: data[data.find(b"\n") + 1 :]]
)
def test_a_line_that_was_changed_or_taken_out_stops_everything(tmp_path: Path, change: Callable[[bytes], bytes]) -> None:
    journal = begin(tmp_path, TEXT, MEANS.utc)
    for entry in (Entry("", Kind.BEGIN, ""), SITTING, START, END):
        journal.note(entry)
    path = journal.folder / NAME
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(RecordError, match="nothing was started") as raised:
        newest(tmp_path, MEANS.utc)
    assert str(journal.folder) in str(raised.value)


@pytest.mark.parametrize("left", [0, 1, 2])
def test_lines_that_are_gone_show_in_the_papers_of_the_jobs(bench: Bench, left: int) -> None:
    """Cut off between two lines a journal is a good one, by itself."""
    journal = interrupted(bench)
    (journal.folder / "jobs" / "a-1").mkdir(parents=True)
    assert newest(bench.home, MEANS.utc) is not None
    path = journal.folder / NAME
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:left]))
    with pytest.raises(RecordError, match=r"has no entry for jobs/a-1.*entries are missing; nothing was started"):
        newest(bench.home, MEANS.utc)
    path.unlink()
    with pytest.raises(RecordError, match="start a new batch"):
        newest(bench.home, MEANS.utc)


def test_a_batch_that_was_killed_before_it_began_is_none(bench: Bench) -> None:
    begin(bench.home, TEXT, MEANS.utc)
    assert newest(bench.home, MEANS.utc) is None
    assert bench.take().is_new


# -- gone on with --------------------------------------------------------------------------------------------------------------


def test_what_was_not_finished_is_gone_on_with_and_what_was_is_begun_anew(bench: Bench) -> None:
    journal = interrupted(bench)
    again = bench.take()
    assert (again.is_new, again.journal.folder) == (False, journal.folder)
    journal.note(END)
    journal.note(FINISH)
    assert "no batch to resume, the last one finished at 2026-09" in bench.problems(resume=True)
    assert bench.take().is_new


def test_there_is_nothing_to_resume_at_first(bench: Bench) -> None:
    assert "no batch to resume, none has begun; leave out --resume to start a new one" in bench.problems(resume=True)


def test_what_will_be_done_is_told_for_each_job_and_nothing_is_done(bench: Bench) -> None:
    interrupted(bench)
    shift = bench.take(resume=True)
    assert [(job.name, text) for job, text in shift.next_steps()] == [
        ("a", "had not begun: it is started"),
        ("b", "waits for its turn"),
    ]
    shift.journal.note(replace(END, state="half done", again=True))
    shift.journal.note(Entry("", Kind.SKIP, "b is skipped.", "b"))
    texts = [text for _, text in bench.take().next_steps()]
    assert texts == ["was half done: it is done again, as a new run", "stays skipped"]


def test_a_run_that_the_journal_has_is_not_forgotten_with_the_papers_of_its_job(bench: Bench) -> None:
    journal = interrupted(bench)
    journal.note(Entry("", Kind.RUN, "a records into run-1.", "a", 1, run="run-1"))
    shift = bench.take(resume=True)
    text = next(text for _, text in shift.next_steps())
    assert text == "was cut off by a crash: run-1 is recovered and recorded as half done, and the job is done again"
    assert result_of(JobDir(bench.out), recorded=bench.out / "run-1").run == bench.out / "run-1"


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ('"dde-2"', '"ucr-1"', None),  # which its recipe does not fit: told before
        (
            'duration = "15m"\nrate = "fit"\n[[job]]',
            'duration = "20m"\nrate = "fit"\n[[job]]',
            'job a: duration was "15m" and is "20m"',
        ),
        ('name = "b"', 'name = "c"', "job b was removed"),
        ('name = "b"', 'name = "c"', "job c is new"),
        ('name = "b"', 'name = "b"\norder = "7"', 'job b: order was not given and is "7"'),
        ("[[job]]", '[[job]]\non_failure = "skip"', 'job a: on_failure was "stop" and is "skip"'),
    ],
)
def test_a_file_that_was_changed_meanwhile_is_told_with_what_changed(
    bench: Bench, before: str, after: str, told: str | None
) -> None:
    journal = interrupted(bench)
    bench.change(before, after)
    said = bench.problems()
    if told is not None:
        assert told in said
        assert "`--anew` discards it and starts a new one; or restore the jobs file" in said
        assert str(journal.folder / "jobs.toml") in said
        assert (journal.folder / "jobs.toml").read_text() == TEXT
    assert [entry.kind for entry in read(journal.folder)][-2:] == ["sitting", "start"]


def test_comments_and_blanks_change_nothing(bench: Bench) -> None:
    interrupted(bench)
    bench.change("[batch]", "# a night\n\n[batch]")
    assert not bench.take().is_new


def test_anew_gives_up_what_there_is(bench: Bench) -> None:
    journal = interrupted(bench)
    bench.change('name = "b"', 'name = "c"')
    new = bench.take(anew=True)
    assert new.is_new
    assert new.journal.folder != journal.folder
    given_up = batch_state(read(journal.folder))
    assert given_up.is_finished
    assert given_up.closing == "Batch discarded: a new one starts in its place."


def test_what_still_runs_is_not_given_up(bench: Bench) -> None:
    shift = bench.take()
    shift.journal.note(SITTING)
    shift.journal.note(START)
    papers = JobDir(shift.journal.folder / "jobs" / "a-1")
    descriptor = papers.make(b"{}")
    try:
        assert "a of the batch of 2026-09" in bench.problems(anew=True)
        assert next(text for _, text in bench.take().next_steps()).startswith("still runs")
    finally:
        os.close(descriptor)


def test_a_file_of_the_same_name_from_elsewhere_is_another_batch(bench: Bench, tmp_path: Path) -> None:
    interrupted(bench)
    (tmp_path / "other").mkdir()
    bench.file = Path(shutil.copy(bench.file, tmp_path / "other" / "night.toml"))
    assert f"has an unfinished batch of {tmp_path / 'night.toml'}" in bench.problems()


def test_a_date_that_is_over_is_told_before_anything_begins(bench: Bench) -> None:
    bench.change('name = "b"', 'name = "b"\nat = "2026-09-20 22:00"')
    with pytest.raises(Problems, match=r'night.toml:11: job\[2\].at: "2026-09-20 22:00" has passed; give a later time, or none'):
        bench.take()
    assert newest(bench.home, MEANS.utc) is None


# -- one at a time -------------------------------------------------------------------------------------------------------------


def test_a_second_one_is_told_who_holds_it(bench: Bench, tmp_path: Path) -> None:
    with ExitStack() as stack:
        stack.enter_context(hold(bench.home, bench.file, "2026-09-21T14:13:20Z"))
        assert f"process {os.getpid()} has been running it since 2026-09-21T14:13:20Z" in refused(bench.home, bench.file)
        assert "another batch of this file runs with another --out" in refused(tmp_path / "elsewhere", bench.file)
    with hold(bench.home, bench.file, "now"):
        pass


def refused(home: Path, file: Path) -> str:
    """What another process is told that wants to hold it."""
    code = f"""
from pathlib import Path
from jbclog.app.batch.single_batch import hold
try:
    with hold(Path({str(home)!r}), Path({str(file)!r}), "now"):
        print("held")
except Exception as error:
    print(type(error).__name__, error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith(UsageError.__name__)
    return done.stdout


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(JbclogError, match="cannot be created or locked"), hold(tmp_path / "runs" / "x.batch", tmp_path, "now"):
        pass
