"""Names and texts from files, people, stations and other people's runs (docs/reference/faults.md,
F-34): shown as text, or refused.

Nothing is written outside the run's folder, nothing on a page can run, nothing printed controls a
terminal.
"""

from __future__ import annotations

import ast
import json
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from hashlib import sha256
from itertools import cycle, islice, product
from pathlib import Path

import pytest

import jbclog
from jbclog.app.run.options import Metadata, RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.config.line import parse_line
from jbclog.config.load_recipe import parse_recipe
from jbclog.core.errors import Problems, RecordError
from jbclog.protocol.frame import Frame
from jbclog.record.annotations import append
from jbclog.record.check import check
from jbclog.record.folder import create_run
from jbclog.record.manifest import DIGEST, END, LONGEST_NAME, NAME, read_manifest
from jbclog.sim.setup import virtual_station
from jbclog.sim.virtual import VirtualStation
from support.campaigns.awaited import INTERNAL_ERROR
from support.campaigns.each_row import each_row
from support.faults.hostile_names import ALLOWED_NAME, HOSTILE, Acting, steers
from support.invoked import invoked
from support.readers.other_desk import forbidden_name
from support.records.small_run import make_run
from support.virtual import recorded_run
from support.virtual.recorded_run import RecordedRun

PACKAGE = Path(jbclog.__file__).parent
every_text = pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)


def every_text_in(*places: str) -> Callable[[Callable[[str, str], None]], Callable[[], None]]:
    """Parametrize with every text in each of these places."""
    return each_row(
        (f"{place}, {name}", (place, text)) for place in places for name, text in HOSTILE.items()
    )


JOINED = " ".join(HOSTILE.values())

LINE = """[line]
name = {line}
[[station]]
name = {station}
url = {url}
family = "dde"
ports = [1]
"""
RECIPE = """[recipe]
name = {name}
revision = 1
families = ["dde"]
[sleep]
delay_min = 5
[hibernation]
delay_min = 30
[metadata]
required = [{required}]
"""


def quoted(text: str) -> str:
    """Quote as a TOML string."""
    return json.dumps(text)


def tree(folder: Path) -> dict[str, bytes | None]:
    """Return every file below a folder, to show additions and changes."""
    paths = sorted(folder.rglob("*"))
    return {
        str(path): path.read_bytes() if path.is_file() and not path.is_symlink() else None
        for path in paths
    }


# -- files: a name is in the list of allowed characters, or refused with a sentence that can be prin


def told(read: Callable[[str, Path], object], text: str) -> str | None:
    """Return what is wrong with a file, or None."""
    try:
        read(text, Path("x.toml"))
    except Problems as problems:
        return str(problems)
    return None


def is_name(text: str) -> bool:
    """Whether a text may be a name: it has the allowed characters only, and is a file's on NTFS."""
    return bool(ALLOWED_NAME.fullmatch(text)) and forbidden_name(Path(text)) is None


@every_text_in("line", "station")
def test_names_in_a_line_file(place: str, text: str) -> None:
    names = {"line": "bench", "station": "dde-1", "url": "/dev/x"} | {place: text}
    wrong = told(parse_line, LINE.format(**{name: quoted(value) for name, value in names.items()}))
    assert (wrong is None) == is_name(text)
    assert steers(wrong or "") == []


@every_text_in("name", "required", "key", "family")
def test_names_in_a_recipe(place: str, text: str) -> None:
    recipe = RECIPE.format(
        name=quoted(text if place == "name" else "job"),
        required=quoted(f"tag.{text}") if place == "required" else "",
    )
    recipe = recipe.replace('"dde"', quoted(text)) if place == "family" else recipe
    recipe = f"{recipe}\n[{quoted(text)}]\nx = 1" if place == "key" else recipe
    wrong = told(parse_recipe, recipe)
    assert steers(wrong or "") == []
    if place != "required":
        assert (wrong is None) == (place == "name" and is_name(text))


@every_text
def test_urls_of_ports(tmp_path: Path, text: str) -> None:
    """An accepted URL is shown, not used: `plan` sends nothing and creates nothing."""
    (tmp_path / "line.toml").write_text(
        LINE.format(line='"bench"', station='"dde-1"', url=quoted(text))
    )
    (tmp_path / "job.toml").write_text(RECIPE.format(name='"job"', required=""))
    before = tree(tmp_path)
    ended = invoked("plan", tmp_path / "job.toml", "--line", tmp_path / "line.toml")
    assert ended.exit_code in (0, 2), ended.output
    assert steers(ended.output) == []
    assert tree(tmp_path) == before


@every_text
def test_a_line_s_name_that_no_file_gave_makes_no_folder_elsewhere(
    tmp_path: Path, text: str
) -> None:
    home = tmp_path / "a" / "b" / "runs"
    if ALLOWED_NAME.fullmatch(text):
        assert create_run(home, text, 1.79e9).parent == home
    else:
        with pytest.raises(RecordError):
            create_run(home, text, 1.79e9)
        assert not (tmp_path / "a").exists()


# -- people ----------------------------------------------------------------------------------------


OPTIONS = (
    "--operator",
    "--order",
    "--product",
    "--unit",
    "--tag",
    "--duration",
    "--rate",
    "--station",
    "--units",
    "--wire-lot",
    "--tip",
)
VERBS = ("check", "report", "recover", "annotate", "sim", "scan", "safe", "runs")


def pairs(places: Sequence[str], *, whole: bool) -> Iterator[tuple[str, str]]:
    """Yield every text in every place, or each text in one place, in turn."""
    return (
        product(places, HOSTILE.values())
        if whole
        else zip(cycle(places), HOSTILE.values(), strict=False)
    )


long_too = pytest.mark.parametrize(
    "whole", [False, pytest.param(True, marks=[pytest.mark.campaign, pytest.mark.timeout(600)])]
)


@long_too
def test_what_is_typed_behind_an_option(tmp_path: Path, whole: bool) -> None:
    (tmp_path / "job.toml").write_text(RECIPE.format(name='"job"', required=""))
    given = [
        str(tmp_path / "job.toml"),
        "--line",
        str(tmp_path / "no-such-line.toml"),
        "--out",
        str(tmp_path / "runs"),
    ]
    for option, text in pairs(OPTIONS, whole=whole):
        ended = invoked("run", *given, f"{option}={text}")
        assert ended.exit_code == 2, (option, text)
        assert steers(ended.output) == [], (option, text)
    assert not (tmp_path / "runs").exists()


@long_too
def test_names_of_files_on_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    for verb, text in pairs(VERBS, whole=whole):
        if "\0" in text or text in ("", ".", ".."):
            continue  # no system passes such an argument, or the folder is a real one
        ended = invoked(verb, "--line" if verb == "safe" else "--", text)
        assert ended.exit_code in (1, 2, 3, 4), (verb, text)
        assert "Traceback" not in ended.output
        assert INTERNAL_ERROR not in ended.output, (verb, text)
        assert steers(ended.output) == [], (verb, text)
        assert list(tmp_path.iterdir()) == []


def test_what_is_said_of_a_run_later(sealed: Path, tmp_path: Path) -> None:
    run = copied(sealed, tmp_path)
    for number, text in enumerate(HOSTILE.values()):
        said = ["--by", "x", "--reason", "x", "--", "x"]
        said[(1, 3, 5)[number % 3]] = text
        ended = invoked("annotate", run, *said)
        assert ended.exit_code in (0, 2), ended.output
        assert steers(ended.output) == []
        append(run, who=f"a{text}", what=f"a{text}", why=f"a{text}")
    told = invoked("annotate", run)
    assert told.exit_code == 0
    assert steers(told.output) == []
    assert check(run) == []


# -- a whole run with every possible text hostile --------------------------------------------------


class Liar:
    """A virtual station with the test's model, software and refusals; check bytes are right."""

    def __init__(self, station: VirtualStation, model: str | None, software: str) -> None:
        self._station, self._model, self._software = station, model, software

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        return [(at, self._bent(answer)) for at, answer in self._station.receive(data, now)]

    def is_unplugged(self, now: float) -> bool:
        return self._station.is_unplugged(now)

    def _bent(self, answer: bytes) -> bytes:
        if b"ASMN" in answer and self._model is not None:
            return Frame("A", f"SMN{self._model}", 1, 0).encode()
        return (
            Frame("A", f"SVR{self._software}", 1, 0).encode()
            if b"ASVR" in answer or b"NSVR" in answer
            else answer
        )


ON_THE_WIRE = [
    text
    for text in HOSTILE.values()
    if text and text.isascii() and text.isprintable() and len(text) < 60
]
"""What a frame can carry (Frame refuses the rest)."""


def hostile_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: str | None, software: str
) -> Path:
    def bent(*given: object, **named: object) -> Liar:
        station = virtual_station(*given, **named)  # type: ignore[arg-type]  # handed on as it came
        assert isinstance(station, VirtualStation)
        return Liar(station, model, software)

    monkeypatch.setattr(recorded_run, "virtual_station", bent)
    home = tmp_path / "home"
    home.mkdir()
    line = LINE.format(line='"bench"', station='"dde-1"', url='"/dev/=cmd|x<b>"')
    (home / "line.toml").write_text(line)
    recipe = home / "=<b onload=x>'\"{{7}}&-$(touch owned).toml"
    recipe.write_text(RECIPE.format(name='"job"', required=""))
    texts = tuple(HOSTILE.values())
    tips = tuple(f"dde-1={text}" for text in texts if text)
    said = Metadata(
        JOINED, JOINED, JOINED, texts, {text: text for text in texts}, texts, texts, tips
    )
    plan = make_plan(RunOptions(home / "line.toml", recipe, duration_s=3.0, metadata=said))
    return RecordedRun(plan, tmp_path / "runs").result.folder


def shown(run: Path, *verbs: str) -> list[str]:
    """Return what commands that read runs print of this one, for people and as JSON."""
    told = []
    for verb in verbs or (
        "report",
        "check",
        "check --json",
        "annotate",
        "annotate --json",
        "recover",
        "runs",
        "runs --json",
    ):
        name, *more = verb.split()
        ended = invoked(name, run, *more)
        assert INTERNAL_ERROR not in ended.output, ended.output
        assert steers(ended.output) == [], f"{verb}: {ended.output}"
        told.append(ended.output)
    return told


@pytest.mark.parametrize("model", [None, pytest.param(ON_THE_WIRE[0], marks=pytest.mark.campaign)])
def test_a_run_full_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: str | None
) -> None:
    software = ON_THE_WIRE[0 if model is None else ON_THE_WIRE.index(model)]
    run = hostile_run(tmp_path, monkeypatch, model, software)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["home", "runs"]
    assert list((tmp_path / "runs").iterdir()) == [run]
    assert check(run) == []
    assert all(shown(run))
    page = (run / "report.html").read_text("utf-8")
    assert Acting(page).found == []
    assert steers(page) == steers((run / "report.json").read_text("utf-8")) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["home", "runs"]


def test_there_are_texts_that_a_frame_can_carry() -> None:
    assert len(ON_THE_WIRE) > 15


# -- somebody else's run: every text of its manifest, of its lines of JSON, of its names -----------


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("sealed"), seconds=2.0)


def copied(run: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(run, tmp_path / "deep" / "runs" / run.name))


def replaced(value: object, texts: Iterator[str], keep: Sequence[str]) -> object:
    """Replace every text of a document, except names of keys and everything below the keys in
    `keep`.
    """
    if isinstance(value, dict):
        return {
            key: one if key in keep else replaced(one, texts, keep) for key, one in value.items()
        }
    if isinstance(value, list):
        return [replaced(one, texts, keep) for one in value]
    return next(texts) if isinstance(value, str) else value


def foreign_manifest(run: Path, first: int, *, keep: Sequence[str] = (), **more: object) -> str:
    """Return the run's manifest with another hostile text in each place, starting with one of them;
    its digest is right.
    """
    texts = islice(cycle(HOSTILE.values()), first, None)
    document = replaced(
        json.loads((run / NAME).read_text()), texts, ("state", "schema", "digest", *keep)
    )
    assert isinstance(document, dict)
    name = next(texts)
    document |= {"previous": {"run": name, "sha256": name, "text": name}, **more}
    del document["digest"]
    text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    return text.removesuffix(END.decode()) + DIGEST % sha256(text.encode()).hexdigest()


KEPT = ("files", "start", "stop")
"""Parts of a foreign manifest without which it would be read as none."""


def is_taken(run: Path) -> bool:
    """Whether a reader accepts the manifest; a station's name of 5000 letters is too long."""
    stations = json.loads((run / NAME).read_text("utf-8"))["stations"]
    return all(len(one["name"]) <= LONGEST_NAME for one in stations)


def test_a_foreign_manifest_is_read_unless_a_station_s_name_is_too_long(
    sealed: Path, tmp_path: Path
) -> None:
    run, taken = copied(sealed, tmp_path), list[bool]()
    for number in range(len(HOSTILE)):
        (run / NAME).write_text(foreign_manifest(sealed, number, keep=KEPT), "utf-8")
        taken.append(is_taken(run))
        if taken[-1]:
            assert read_manifest(run).stations[0].name in HOSTILE.values()
        else:
            with pytest.raises(RecordError, match=f"at most {LONGEST_NAME}"):
                read_manifest(run)
    assert taken.count(False) == 2  # the two stations, each once


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("first", [7, None])
def test_every_text_of_a_foreign_manifest(
    sealed: Path, tmp_path: Path, first: int | None, counted: Callable[..., None]
) -> None:
    for number in range(len(HOSTILE)) if first is None else [first]:
        run = copied(sealed, tmp_path / str(number))
        (run / NAME).write_text(foreign_manifest(run, number))
        outside = tree(tmp_path)
        assert all(shown(run, "check", "annotate", "recover", "runs", "runs --json"))
        (run / NAME).write_text(foreign_manifest(sealed, number, keep=KEPT))
        outside |= {str(run / NAME): (run / NAME).read_bytes()}
        assert all(shown(run))
        now = tree(tmp_path)
        assert {
            name for name in now.keys() - outside.keys() if not Path(name).is_relative_to(run)
        } == set()
        assert {name: data for name, data in now.items() if name in outside} == outside
        page = run / "report.html"
        assert page.exists() == is_taken(run)
        assert not page.exists() or Acting(page.read_text("utf-8")).found == []
        counted(foreign_manifests=2, pages=page.exists())


@pytest.mark.parametrize(
    "name", ["damage.jsonl", "guard.jsonl", "annotations.jsonl", "lease.json", "report.json"]
)
def test_lines_of_a_foreign_run_s_other_files(sealed: Path, tmp_path: Path, name: str) -> None:
    run = copied(sealed, tmp_path)
    keys = (
        "place",
        "why",
        "kind",
        "severity",
        "text",
        "station",
        "name",
        "url",
        "manifest_sha256",
        "who",
        "what",
    )
    lines = [json.dumps(dict.fromkeys(keys, text)) for text in HOSTILE.values()]
    (run / name).write_text("\n".join([*lines, *HOSTILE.values()]))
    assert all(shown(run, "check", "annotate", "recover"))


@every_text
def test_a_foreign_run_that_is_not_finished(sealed: Path, tmp_path: Path, text: str) -> None:
    """`recover` writes only into the folder that it was given."""
    run = copied(sealed, tmp_path)
    (run / NAME).write_text(
        foreign_manifest(run, [*HOSTILE.values()].index(text), state="open", files=[])
    )
    (run / "guard.jsonl").write_text(
        json.dumps(
            {"time": 1, "kind": text, "severity": "info", "text": text, "station": text, "port": 1}
        )
    )
    outside = {
        name: data for name, data in tree(tmp_path).items() if not Path(name).is_relative_to(run)
    }
    ended = invoked("recover", run)
    assert INTERNAL_ERROR not in ended.output, ended.output
    assert steers(ended.output) == []
    assert {
        name: data for name, data in tree(tmp_path).items() if not Path(name).is_relative_to(run)
    } == outside


# -- links -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "annotations.jsonl",
        "report.html",
        "report.json",
        "figures",
        "manifest.json",
        "damage.jsonl",
        "damaged",
    ],
)
def test_a_link_in_a_run_s_folder_is_not_written_through(
    sealed: Path, tmp_path: Path, name: str
) -> None:
    """A run copied from elsewhere may contain a link; no command changes the link's target."""
    run, target = copied(sealed, tmp_path), tmp_path / "target"
    if name in ("figures", "damaged"):
        target.mkdir()
    else:
        target.write_bytes((run / name).read_bytes() if (run / name).exists() else b"precious")
    (run / name).unlink(missing_ok=True)
    (run / name).symlink_to(target)
    before = tree(target) if target.is_dir() else target.read_bytes()
    assert all(shown(run))
    invoked("annotate", run, "x", "--by", "x", "--reason", "x")
    assert (tree(target) if target.is_dir() else target.read_bytes()) == before


def test_a_folder_for_runs_may_be_a_link_that_the_user_made(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "runs").symlink_to(tmp_path / "disk")
    assert create_run(tmp_path / "runs", "bench", 1.79e9).parent == tmp_path / "runs"


# -- structure: everything printed passes through the one function that cleans ---------------------

PRINTS = {
    "cli/output.py": "cleans",
    "cli/app.py": "the version",
    "cli/front_page.py": "the program's own help",
    "live/joint_counter.py": (
        "a child's, JSON through a pipe to whoever watches, who cleans what is shown"
    ),
    "record/seal.py": "a child's, told to its parent through a pipe and printed by it",
    "sim/__main__.py": "a child's, whose sentences are cleaned where they are made",
}


def prints(path: Path) -> bool:
    text = path.read_text("utf-8")
    if not re.search(r"\bprint\b|echo\b|\bwrite\b", text):  # parsing all of them takes a second
        return False
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called in ("print", "typer.echo", "typer.secho", "click.echo") or called.endswith(
                ("stdout.write", "stderr.write")
            ):
                return True
    return False


def test_only_one_place_prints() -> None:
    found = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py") if prints(path)}
    assert found == set(PRINTS)
