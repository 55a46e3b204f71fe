"""Concurrency: forty processes that want the same run name, readers while a run is written.

docs/reference/faults.md, F-32 and F-43.
"""

from __future__ import annotations

import os
import secrets
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError
from jbclog.record import folder as folders
from jbclog.record.folder import create_run
from support.product import seal_part
from support.records import few_rows

PROCESSES, NAMES = 40, 16


def in_a_process(act: Callable[[], str], waiting: int, begin: int) -> int:
    """Start a child that waits until `begin` is closed and writes the result of `act` into a pipe;
    return its other end.
    """
    reading, writing = os.pipe()
    if os.fork():
        os.close(writing)
        return reading
    try:
        os.close(begin)
        os.read(waiting, 1)
        os.write(writing, act().encode())
    finally:
        os._exit(0)


def test_forty_processes_that_want_one_of_sixteen_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sixteen get their own folder, all others a refusal, and none gets another's."""
    monkeypatch.setattr(
        folders.secrets, "choice", lambda _letters: secrets.SystemRandom().choice("ab")
    )

    def act() -> str:
        try:
            made = create_run(tmp_path, "bench", 1.79e9)
            (made / "mine").write_text(str(os.getpid()))
            return made.name
        except RecordError as error:
            return f"refused: {error}"

    waiting, begin = os.pipe()
    ends = [in_a_process(act, waiting, begin) for _ in range(PROCESSES)]
    os.close(begin)
    told = [os.read(end, 4096).decode() for end in ends]
    for end in (*ends, waiting):
        os.close(end)
    for _ in range(PROCESSES):
        os.wait()
    made = [name for name in told if not name.startswith("refused")]
    assert len(made) == len(set(made)) <= NAMES
    assert len(told) == PROCESSES
    assert {path.name for path in tmp_path.iterdir()} == set(made)
    assert all("no free name" in text for text in told if text not in made)


@pytest.mark.parametrize(
    "rounds", [12, pytest.param(150, marks=[pytest.mark.campaign, pytest.mark.timeout(600)])]
)
def test_readers_see_every_row_once_while_the_run_is_written_and_sealed(
    tmp_path: Path, rounds: int
) -> None:
    """Committed rows are there, whole and in order, at any moment of sealing."""
    store = few_rows.begun(tmp_path)
    committed, is_over, wrong, looks = 0, threading.Event(), list[str](), 0

    def look() -> None:
        nonlocal looks
        while not is_over.is_set():
            least = committed
            try:
                ticks = open_run(store.folder).samples(columns=["tick"])["tick"].tolist()
            except Exception as error:
                wrong.append(f"{type(error).__name__}: {error}")
                return
            looks += 1
            if ticks != list(range(len(ticks))) or len(ticks) < least:
                wrong.append(f"{len(ticks)} rows, {least} were committed")

    readers = [threading.Thread(target=look) for _ in range(3)]
    for reader in readers:
        reader.start()
    for number in range(rounds):
        few_rows.hand_over(store, range(number * 20, number * 20 + 20))
        store.commit_now()
        committed = number * 20 + 20
        if number % 3 == 2:
            seal_part(store.folder)
    is_over.set()
    for reader in readers:
        reader.join()
    store.close()
    store.release()
    assert wrong == []
    assert looks >= 3
    print(f"{looks} looks at a run of {committed} rows, sealed {rounds // 3} times meanwhile")
