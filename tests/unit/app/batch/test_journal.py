"""A batch's journal on disk: cut off anywhere, changed anywhere, held by another, asked to go on
with what is not the same.
"""

from __future__ import annotations

import errno
import json
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
from jbclog.app.batch.job_dir import EVENTS, JobDir, JobResult, unread_serial
from jbclog.app.batch.job_spec import BatchPlan, plan_batch
from jbclog.app.batch.journal import Journal, begin, entries_in, home_of, newest
from jbclog.app.batch.processes import result_of
from jbclog.app.batch.resume import PreparedBatch, prepare
from jbclog.app.batch.single_batch import hold
from jbclog.app.batch.state import Entry, EntryKind, batch_state
from jbclog.config.jobs_file import load_jobs
from jbclog.core.errors import JbclogError, Problems, RecordError, UsageError
from jbclog.core.line_file import PAGE
from support.command import BENCH, PROFILES

NIGHT = 1_790_000_000.0
RECIPE = PROFILES / "recipes" / "sac305-smd.toml"
MEANS = Timing(lambda: NIGHT, lambda: None)
EXECUTION = Entry("", EntryKind.EXECUTION, "Batch started.")
START = Entry("", EntryKind.START, "a is started.", "a", 1)
END = Entry("", EntryKind.END, "", "a", 1, "done", False, 0, "ACCEPT", "run-1")
FINISH = Entry("", EntryKind.FINISH, "Every job has come to its end.")
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
        return prepare(self.plan(), self.out, MEANS, resume=resume, anew=anew)

    def change(self, before: str, after: str) -> None:
        assert before in TEXT
        self.file.write_text(TEXT.replace(before, after))

    def failure(self) -> str:
        with pytest.raises(RecordError) as raised:
            self.take()
        return str(raised.value)

    def problems(self, **how: bool) -> str:
        with pytest.raises(UsageError) as raised:
            self.take(**how)
        return str(raised.value)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def interrupted(bench: Bench) -> Journal:
    journal = bench.take().journal
    journal.note(EXECUTION)
    journal.note(START)
    return journal


# -- what a crash leaves ---------------------------------------------------------------------------


def begun(home: Path, *noted: Entry) -> Journal:
    """A batch whose executor has died."""
    journal = begin(home, TEXT, MEANS.utc)
    for entry in noted:
        journal.note(entry)
    return journal


BATCH = (Entry("", EntryKind.BEGIN, ""), EXECUTION, START, END)


def change_first(data: bytes) -> bytes:
    return data.replace(b"a is started", b"b is started")


def take_out_first(data: bytes) -> bytes:
    return data.partition(b"\n")[2]


def take_out_third(data: bytes) -> bytes:
    lines = data.splitlines(keepends=True)
    return b"".join([*lines[:2], *lines[3:]])


def overwrite_middle(data: bytes) -> bytes:
    return data[:300] + bytes(range(256)) + data[556:]


@pytest.mark.parametrize("change", [change_first, take_out_first, take_out_third, overwrite_middle])
def test_a_journal_that_was_changed_stops_everything(
    tmp_path: Path, change: Callable[[bytes], bytes]
) -> None:
    journal = begun(tmp_path, *BATCH)
    journal.path.write_bytes(change(journal.path.read_bytes()))
    with pytest.raises(RecordError, match=r"journal.jsonl: line \d.*nothing was started") as raised:
        newest(tmp_path, MEANS.utc)
    assert str(journal.folder) in str(raised.value)


def test_an_entry_that_was_cut_off_anywhere_was_not_written(tmp_path: Path) -> None:
    journal = begun(tmp_path, *BATCH)
    whole = journal.path.read_bytes()
    last = whole[:-1].rindex(b"\n") + 1
    for end in range(last, len(whole)):
        journal.path.write_bytes(whole[:end])
        is_whole = end == len(whole) - 1
        assert [entry.kind for entry in entries_in(journal.folder)] == [
            entry.kind for entry in BATCH[: 3 + is_whole]
        ]
        again = newest(tmp_path, MEANS.utc)
        assert again is not None
        again.note(FINISH)
        assert entries_in(journal.folder)[-1].kind == "finish"


def test_a_journal_that_is_larger_than_any_batch_stops_everything(tmp_path: Path) -> None:
    journal = begun(tmp_path, *BATCH)
    os.truncate(journal.path, (64 << 20) + 1)
    with pytest.raises(
        RecordError, match=r"has 67108865 bytes; a batch's journal has at most 67108864"
    ):
        newest(tmp_path, MEANS.utc)


def test_events_are_read_a_page_at_a_time(tmp_path: Path) -> None:
    job = JobDir(tmp_path / "jobs" / "a-1")
    os.close(job.make(b"{}"))
    line = json.dumps([1, "unit.next", "info", "x" * 1000, None, None, None, None, None, None])
    count = 2 * PAGE // len(line)
    (job.folder / EVENTS).write_text(
        "".join(f'{line[:-1]}, "S{number}"]\n' for number in range(count))
    )
    first, since = job.events(0)
    assert 0 < len(first) < count
    assert since <= PAGE
    assert [event.raw for event in job.each_event()] == [f"S{number}" for number in range(count)]
    job.set_result(JobResult(0))
    assert unread_serial([job]) == f"S{count - 1}"


def test_a_journal_that_was_removed_takes_no_more_entries(tmp_path: Path) -> None:
    journal = begun(tmp_path, EXECUTION)
    journal.path.unlink()
    with pytest.raises(RecordError, match=r"cannot be written: No such file.*; no more jobs start"):
        journal.note(START)
    assert not journal.path.exists()


def test_a_full_disk_takes_no_entry_and_the_next_one_follows_the_last_that_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, really = begun(tmp_path, EXECUTION), os.pwrite
    room = [100]

    def full(descriptor: int, data: bytes, at: int) -> int:
        if not room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return really(descriptor, data[: room.pop()], at)

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", full)
        with pytest.raises(
            RecordError,
            match=r"No space left on device; no more jobs start\. Running jobs continue",
        ):
            journal.note(START)
    assert [job.name for job in journal.state.running()] == []
    journal.note(START)
    assert [entry.kind for entry in entries_in(journal.folder)] == ["sitting", "start"]


@pytest.mark.parametrize("left", [0, 1, 2])
def test_entries_that_are_missing_show_in_the_folders_of_the_jobs(bench: Bench, left: int) -> None:
    """Cut off between two entries a journal is valid by itself."""
    journal = interrupted(bench)
    (journal.folder / "jobs" / "a-1").mkdir(parents=True)
    assert newest(bench.home, MEANS.utc) is not None
    lines = journal.path.read_bytes().splitlines(keepends=True)
    journal.path.write_bytes(b"".join(lines[:left]))
    with pytest.raises(
        RecordError, match=r"no entry for jobs/a-1.*entries are missing; nothing was started"
    ):
        newest(bench.home, MEANS.utc)
    journal.path.unlink()
    with pytest.raises(RecordError, match="start a new batch"):
        newest(bench.home, MEANS.utc)


# -- new or resumed --------------------------------------------------------------------------------


def test_a_batch_that_was_killed_before_it_began_is_none(bench: Bench) -> None:
    begin(bench.home, TEXT, MEANS.utc)
    assert newest(bench.home, MEANS.utc) is None
    assert bench.take().is_new


# -- gone on with ----------------------------------------------------------------------------------


def test_what_was_not_finished_is_gone_on_with_and_what_was_is_begun_anew(bench: Bench) -> None:
    journal = interrupted(bench)
    again = bench.take()
    assert (again.is_new, again.journal.folder) == (False, journal.folder)
    journal.note(END)
    journal.note(FINISH)
    assert "no batch to resume, the last one finished at 2026-09" in bench.problems(resume=True)
    assert bench.take().is_new


def test_there_is_nothing_to_resume_at_first(bench: Bench) -> None:
    assert (
        "no batch to resume, none has begun; leave out --resume to start a new one"
        in bench.problems(resume=True)
    )


def test_what_will_be_done_is_told_for_each_job_and_nothing_is_done(bench: Bench) -> None:
    interrupted(bench)
    shift = bench.take(resume=True)
    assert [(job.name, text) for job, text in shift.next_steps()] == [
        ("a", "had not begun: it is started"),
        ("b", "waits for its turn"),
    ]
    shift.journal.note(replace(END, state="half done", again=True))
    shift.journal.note(Entry("", EntryKind.SKIP, "b is skipped.", "b"))
    texts = [text for _, text in bench.take().next_steps()]
    assert texts == ["was half done: it is done again, as a new run", "stays skipped"]


def test_a_run_that_the_journal_has_is_not_forgotten_with_the_papers_of_its_job(
    bench: Bench,
) -> None:
    journal = interrupted(bench)
    journal.note(Entry("", EntryKind.RUN, "a records into run-1.", "a", 1, run="run-1"))
    shift = bench.take(resume=True)
    text = next(text for _, text in shift.next_steps())
    assert (
        text
        == "was cut off by a crash: run-1 is recovered and recorded as half done, and the job is"
        " done again"
    )
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
    assert [entry.kind for entry in entries_in(journal.folder)][-2:] == ["sitting", "start"]


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
    given_up = batch_state(entries_in(journal.folder))
    assert given_up.is_finished
    assert given_up.closing == "Batch discarded: a new one starts in its place."


def test_what_still_runs_is_not_given_up(bench: Bench) -> None:
    shift = bench.take()
    shift.journal.note(EXECUTION)
    shift.journal.note(START)
    papers = JobDir(shift.journal.folder / "jobs" / "a-1")
    descriptor = papers.make(b"{}")
    try:
        assert "a of the batch of 2026-09" in bench.problems(anew=True)
        assert next(text for _, text in bench.take().next_steps()).startswith("still runs")
    finally:
        os.close(descriptor)


def test_a_file_of_the_same_name_from_elsewhere_is_another_batch(
    bench: Bench, tmp_path: Path
) -> None:
    interrupted(bench)
    (tmp_path / "other").mkdir()
    bench.file = Path(shutil.copy(bench.file, tmp_path / "other" / "night.toml"))
    assert f"has an unfinished batch of {tmp_path / 'night.toml'}" in bench.problems()


def test_a_date_that_is_over_is_told_before_anything_begins(bench: Bench) -> None:
    bench.change('name = "b"', 'name = "b"\nat = "2026-09-20 22:00"')
    with pytest.raises(
        Problems,
        match=(
            r'night.toml:11: job\[2\].at: "2026-09-20 22:00" has passed; give a later time, or none'
        ),
    ):
        bench.take()
    assert newest(bench.home, MEANS.utc) is None


# -- one at a time ---------------------------------------------------------------------------------


def test_a_second_one_is_told_who_holds_it(bench: Bench, tmp_path: Path) -> None:
    with ExitStack() as stack:
        stack.enter_context(hold(bench.home, bench.file, "2026-09-21T14:13:20Z"))
        assert f"process {os.getpid()} has been running it since 2026-09-21T14:13:20Z" in refused(
            bench.home, bench.file
        )
        assert "another batch of this file runs with another --out" in refused(
            tmp_path / "elsewhere", bench.file
        )
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
    with (
        pytest.raises(JbclogError, match="cannot be created or locked"),
        hold(tmp_path / "runs" / "x.batch", tmp_path, "now"),
    ):
        pass
