"""Where a store may be: storage on which one publisher could overwrite another's commit is refused,
and nothing is written to it.

S3 is a real server process. A share is a file system in a user program, mounted by the kernel
(FUSE), whose hard links fail or are copies. The one whose links overwrite is a folder with a
preloaded library, because the kernel checks first whether a name exists.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path

import pandas as pd
import pytest

import jbclog
from jbclog.analysis.store.place import place_of
from jbclog.analysis.store.runs import StoredRuns
from jbclog.analysis.store.schema import DATA, TABLES
from jbclog.app.publish.publisher import Publisher, Result
from jbclog.app.publish.safe_place import expect_safe
from jbclog.app.publish.upkeep import check, compact, vacuum
from jbclog.core.errors import RecordError, UsageError
from jbclog.record import annotations
from jbclog.record.find_runs import ALL
from support.faults.fuse_share import LINKS, fuse_share
from support.faults.s3_server import BUCKET, KEY, SECRET, Server, serving
from support.faults.small_disk import small_disk
from support.invoked import invoked
from support.records import small_run

from .conftest import made

URL = f's3://{BUCKET}/plant 1/a=b "c" d\'é'
COMMAND = [sys.executable, "-c", "from jbclog.cli import main; main()"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_run.make_run(tmp_path_factory.mktemp("runs"), 12.0)


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with serving() as one:
        yield one


@pytest.fixture
def s3(server: Server, monkeypatch: pytest.MonkeyPatch) -> Server:
    credentials(server, monkeypatch)
    return server


def credentials(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in server.environment.items():
        monkeypatch.setenv(name, value)


def refused(run: Path, store: str, code: int, capfd: pytest.CaptureFixture[str]) -> str:
    """Return the one line with which `publish` ends with that code; libraries below it print
    nothing.
    """
    ended = invoked("publish", run, store)
    assert (ended.exit_code, ended.stdout, *capfd.readouterr()) == (code, "", "", "")
    (line,) = ended.stderr.splitlines()
    return line


def test_all_of_it_in_s3(run: Path, s3: Server) -> None:
    """Published once, read cell by cell, versioned, checked, compacted, vacuumed: by a server that
    speaks S3.
    """
    place = place_of(URL)
    with Publisher(place) as one:
        assert one.publish(run).result is Result.PUBLISHED
        assert one.publish(run).result is Result.THERE
        with pytest.raises(UsageError, match="a publisher is at work"):
            vacuum(place)
    (there,) = jbclog.open_runs(URL, line="bench")
    for table in DATA:
        pd.testing.assert_frame_equal(
            getattr(there, table)(), getattr(jbclog.open_run(run), table)()
        )
    assert jbclog.open_run(f"{URL}/{run.name}").place == f"{URL}/{run.name}"
    runs = StoredRuns(place, ALL)
    assert runs.statistics(by=["run"])["n"].tolist() == [there.samples()["temperature_c"].count()]
    assert [len(rows) for _, rows in runs.metric_rows()] == [len(there.metrics())]
    assert check(place, timedelta(0)).findings == []
    assert set(compact(place)) == set(TABLES)
    assert set(vacuum(place).values()) == {0}
    assert [name for name in s3.names() if "_probe" in name or "_publishers" in name] == []


@pytest.mark.campaign
def test_publishing_from_two_hosts_is_one_run(run: Path, s3: Server, tmp_path: Path) -> None:
    url = f"s3://{BUCKET}/two"
    processes = [
        subprocess.Popen(
            [*COMMAND, "publish", str(run), url],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in ("one host", "another")
    ]
    said = [process.communicate(timeout=120)[0].strip() for process in processes]
    assert sorted(text.partition(": ")[2] for text in said) == [
        f"{result.value} (version 1)" for result in (Result.THERE, Result.PUBLISHED)
    ]
    assert check(place_of(url), timedelta(0)).leftovers == []
    assert len(jbclog.open_runs(url)[0].samples()) == len(jbclog.open_run(run).samples())


@pytest.mark.parametrize("how", ["ignore", "refuse"])
def test_s3_without_conditional_writes_is_refused(
    run: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    with serving(how) as server:
        credentials(server, monkeypatch)
        with pytest.raises(
            (UsageError, RecordError), match=r"conditional writes|If-None-Match"
        ) as refused:
            expect_safe(place_of(f"s3://{BUCKET}/x"))
        assert str(refused.value).count("\n") == 0
        assert server.names() == []


def test_the_unsafe_option_of_the_library_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_S3_ALLOW_UNSAFE_RENAME", "true")
    with pytest.raises(UsageError, match="overwrite each other"):
        place_of("s3://bucket/x")


@pytest.mark.parametrize(
    "url", ["gs://bucket/x", "abfss://x@y/z", "http://host/x", f"s3://{KEY}:{SECRET}@bucket/x"]
)
def test_other_urls_are_refused_without_their_secrets(url: str) -> None:
    with pytest.raises(UsageError) as refused:
        place_of(url)
    assert SECRET not in str(refused.value)


def test_missing_and_wrong_credentials_are_one_line_without_them(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("HOME", str(tmp_path))
    # it lets the bucket's creator in, and asks for keys from then on
    with serving(free_calls=1) as server:
        credentials(server, monkeypatch)
        for gone in ([], ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"]):
            for name in gone:
                monkeypatch.delenv(name)
            line = refused(run, f"s3://{BUCKET}/x", 4, capfd)
            assert line.startswith(f"error: s3://{BUCKET}/x")
            assert "AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY" in line
            assert SECRET not in line
            assert KEY not in line
            assert "Traceback" not in line


def test_a_server_that_is_gone_is_one_line(
    run: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    credentials(Server(1), monkeypatch)
    assert "Connection refused" in refused(run, "s3://bucket/x", 4, capfd)


@pytest.mark.parametrize(
    ("how", "said"), [("none", "no hard links"), ("overwrite", "take the name of a finished file")]
)
def test_a_share_without_atomic_names_is_refused(
    run: Path, tmp_path_factory: pytest.TempPathFactory, how: str, said: str
) -> None:
    share = tmp_path_factory.mktemp("share")
    environment = {
        "LD_PRELOAD": str(made("odd_share", tmp_path_factory)),
        "ODD_SHARE": str(share),
        "ODD_LINKS": how,
    }
    command = [*COMMAND, "publish", str(run), str(share / "store")]
    ended = subprocess.run(
        command,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (ended.returncode, ended.stdout) == (2, "")
    (line,) = ended.stderr.splitlines()
    assert said in line
    assert "nothing was written" in line
    assert [path for path in share.rglob("*") if path.is_file()] == []


@pytest.fixture
def share(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Return the program that mounts a share, by the kind of its hard links."""
    with ExitStack() as mounted:

        def mount(links: str) -> Path:
            try:
                made_share = fuse_share(tmp_path / "share", tmp_path / "behind", links)
                return mounted.enter_context(made_share)
            except OSError as error:
                pytest.skip(f"needs root and FUSE, to mount a share: {error}")

        yield mount


def published(run: Path, store: Path) -> subprocess.Popen[str]:
    command = [*COMMAND, "publish", str(run), str(store)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    ("links", "said"),
    [
        ("EPERM", "no hard links (Operation not permitted)"),
        pytest.param("ENOSYS", "no hard links", marks=pytest.mark.campaign),
        pytest.param("EOPNOTSUPP", "no hard links", marks=pytest.mark.campaign),
        ("copies", "hard links are copies"),
    ],
)
def test_a_mounted_share_without_hard_links_is_refused(
    run: Path, share: Callable[[str], Path], links: str, said: str
) -> None:
    place = share(links)
    publisher = published(run, place / "store")
    out, wrong = publisher.communicate(timeout=120)
    assert (publisher.returncode, out) == (2, "")
    (line,) = wrong.splitlines()
    assert said in line
    assert "nothing was written" in line
    assert [path for path in place.rglob("*") if path.is_file()] == []


def test_a_mounted_share_is_written_by_two_at_once_and_read(
    run: Path, share: Callable[[str], Path]
) -> None:
    store = share(LINKS) / 'plant 1 a=b "c"'
    both = [published(run, store) for _ in range(2)]
    said = [one.communicate(timeout=200) for one in both]
    assert [one.returncode for one in both] == [0, 0], said
    assert sorted(out.split(": ")[1] for out, _ in said) == [
        "already there (version 1)\n",
        "published (version 1)\n",
    ]
    found = check(place_of(store), timedelta(0))
    assert (found.findings, found.runs, found.leftovers) == ([], 1, [])
    (read,) = jbclog.open_runs(store)
    pd.testing.assert_frame_equal(read.samples(), jbclog.open_run(run).samples())


@pytest.mark.parametrize("free", [pytest.param(40_000, marks=pytest.mark.campaign), 90_000])
def test_a_disk_that_is_full_in_the_middle(run: Path, tmp_path: Path, free: int) -> None:
    """The run does not count, and is published whole once there is room."""
    with small_disk(tmp_path / "disk", "8m") as disk:
        place, filler = place_of(disk / "store"), disk / "filler"
        with Publisher(place) as one:
            left = os.statvfs(disk)
            filler.write_bytes(bytes(left.f_bavail * left.f_frsize - free))
            with pytest.raises(RecordError, match="No space left") as full:
                one.publish(run)
            assert "\n" not in str(full.value)
            assert len(jbclog.open_runs(place.url)) == 0
            filler.unlink()
            assert one.publish(run).result is Result.PUBLISHED
        found = check(place, timedelta(0))
        assert (found.findings, found.runs) == ([], 1)
        assert len(jbclog.open_runs(place.url)[0].samples()) == len(jbclog.open_run(run).samples())
        assert check(place, timedelta(0)).leftovers == []


@pytest.mark.campaign
def test_an_annotation_in_s3_is_a_version(run: Path, s3: Server) -> None:
    url = f"s3://{BUCKET}/versions"
    with Publisher(place_of(url)) as one:
        one.publish(run)
        annotations.append(run, who="A. Rossi", what="a remark", why="a test")
        assert one.publish(run).result is Result.VERSIONED
    assert len(jbclog.open_runs(url)) == 1
