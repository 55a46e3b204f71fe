"""What a transcript's `given:` lines name: each a small function of the stage and the rest of the
line.
"""

from __future__ import annotations

import re
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jbclog.app import connection, discovery
from jbclog.app.audit import survey
from jbclog.app.batch.journal import home_of
from jbclog.app.batch.single_batch import hold
from jbclog.config.line import parse_line
from jbclog.core.errors import LinkError
from jbclog.record.run_journal import RunJournal
from jbclog.sim.port import WORKING
from support.command import PROFILES, recipe_text
from support.links.uart_ports import Cable, Silence, access_to, station_cable
from support.records.few_rows import abandoned, vanish
from support.records.many_runs import many_runs, one_run
from support.records.small_run import begin, fill, make_run
from support.virtual.answers import let_say
from support.virtual.manual import LINE, Wire, station_text
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import line_text

if TYPE_CHECKING:
    from support.transcripts.stage import Stage

KEYS_OF: Final = {"omega": 'baudrate = 9600\nformat = "8N1"'}
DATA: Final = Path(__file__).parents[2] / "data"
RECIPES: Final = PROFILES / "recipes"
MADE: Final[dict[str, Path]] = {}
"""Runs that were made for an earlier case, by name; each case has copies."""


def station(stage: Stage, text: str) -> None:
    """``station NAME FAMILY; KEY = VALUE; ...``, with keys of [station.sim]: on the line line.toml,
    and there.
    """
    words, *sim = text.split("; ")
    name, family = words.split()
    path = stage.folder / "line.toml"
    before = path.read_text(encoding="utf-8") if path.exists() else LINE
    keys = KEYS_OF.get(family, "")
    path.write_text(before + station_text(name, family, keys, "\n".join(sim)), encoding="utf-8")
    (*_, spec) = parse_line(path.read_text(encoding="utf-8"), path).stations
    stage.names[name] = spec.url
    stage.wires[spec.url] = Wire(spec, stage.clock)


def recipe(stage: Stage, text: str) -> None:
    """``recipe FAMILY ...``: recipe.toml, 350 °C at work. ``recipe FAMILY ...; LINE; ...``: its
    head and these lines.
    """
    words, *lines = text.split("; ")
    families = words.split()
    whole = recipe_text("tht", *families)
    if lines:
        head, _, _ = whole.partition("[temperature]")
        whole = head + "".join(f"{line}\n" for line in lines)
    (stage.folder / "recipe.toml").write_text(whole, encoding="utf-8")


def edit(stage: Stage, text: str) -> None:
    """``edit FILE: OLD -> NEW``, FILE or the only one of a pattern; ``\\n`` ends a line."""
    name, _, change = text.partition(": ")
    old, new = (part.replace("\\n", "\n") for part in change.split(" -> "))
    (path,) = stage.folder.glob(name)
    content = path.read_text(encoding="utf-8")
    assert old in content, f"{name} has no {old!r}"
    path.write_text(content.replace(old, new, 1), encoding="utf-8")


def append(stage: Stage, text: str) -> None:
    """``append FILE: TEXT``; the file is made if there is none."""
    name, _, more = text.partition(": ")
    paths = list(stage.folder.glob(name)) or [stage.folder / name]
    with paths[0].open("a", encoding="utf-8") as file:
        file.write(more.replace("\\n", "\n") + "\n")


def encoded(stage: Stage, text: str) -> None:
    """``encoded FILE ENCODING``: the file is saved anew in another encoding."""
    name, encoding = text.split()
    path = stage.folder / name
    path.write_bytes(path.read_text(encoding="utf-8").encode(encoding))


def bytes_more(stage: Stage, text: str) -> None:
    """``bytes_more FILE N``: so many spaces at its end."""
    name, count = text.split()
    with (stage.folder / name).open("ab") as file:
        file.write(b" " * int(count))


def lines_end(stage: Stage, text: str) -> None:
    """``lines_end FILE \\\\r``: with these characters."""
    name, end = text.split()
    path = stage.folder / name
    path.write_bytes(
        path.read_bytes().replace(b"\n", end.encode().decode("unicode_escape").encode())
    )


def at_work(stage: Stage, name: str) -> None:
    """All tools of the station are at work, as a robot leaves them."""
    for port in stage.wire(name).station.plant.ports.values():  # type: ignore[union-attr]
        port.order(WORKING, False)


def seconds(stage: Stage, text: str) -> None:
    """They pass."""
    stage.clock.advance_to(stage.clock.monotonic() + float(text))


def unplugged(stage: Stage, name: str) -> None:
    def watch(_: str) -> None:
        raise LinkError("the cable is out")

    stage.wire(name).watch = watch


def silent(stage: Stage, name: str) -> None:
    """It hears, and does not answer."""
    stage.wire(name).station.receive = lambda data, now: []  # type: ignore[method-assign]


def only_acknowledged(stage: Stage, text: str) -> None:
    """``only_acknowledged NAME CODE``: such a write is acknowledged and has no effect."""
    name, code = text.split()
    stage.wire(name).only_acknowledged = code


def says(stage: Stage, text: str) -> None:
    """``says NAME CODE DATA ...``: the data of its first answers to this question."""
    name, code, *data = text.split()
    let_say(stage.wire(name).station.device, code, *data)  # type: ignore[union-attr]


def always_says(stage: Stage, text: str) -> None:
    name, code, *data = text.split()
    let_say(stage.wire(name).station.device, code, *data, last=True)  # type: ignore[union-attr]


def cable(stage: Stage, text: str) -> None:
    """``cable URL FAMILY``: for `scan`, a port with a station at its own line format."""
    url, family = text.split()
    stage.cables[url] = station_cable(family, KEYS_OF.get(family, ""), clock=stage.clock)
    stage.access = access_to(stage.cables, stage.clock)


def silent_cable(stage: Stage, url: str) -> None:
    """For `scan`: a port behind which nobody is."""
    stage.cables[url] = Cable(Silence(), None)
    stage.access = access_to(stage.cables, stage.clock)


def no_ports(stage: Stage, _: str) -> None:
    """For `scan`: no port can be opened."""
    stage.access = access_to(stage.cables, stage.clock)


def held_by_run(stage: Stage, text: str) -> None:
    """A run in progress holds every port."""
    folder = Path(text)
    for module in (connection, discovery, survey):
        stage.patches.setattr(module, "run_that_holds", lambda url: folder)
    stage.conduct.held = {name: f"{name}: its port is held by {folder}" for name in stage.names}


def open_in_program(stage: Stage, _: str) -> None:
    """Another program has every port open."""
    for module in (discovery, survey):
        stage.patches.setattr(module, "sharers_of", lambda url: [4711])


def interrupted(stage: Stage, text: str) -> None:
    """``interrupted SIGINT 5``: the next run gets this signal after so many seconds."""
    name, second = text.split()
    stage.conduct.interrupted = signal.Signals[name], float(second)


# -- runs ------------------------------------------------------------------------------------------


def copied(stage: Stage, name: str, make: Callable[[Path], object]) -> None:
    """What `make` makes below a folder, copied to that of the case."""
    if name not in MADE:
        MADE[name] = stage.factory.mktemp(name)
        make(MADE[name])
    shutil.copytree(MADE[name], stage.folder, dirs_exist_ok=True)


def run(stage: Stage, text: str) -> None:
    """``run [NAME]``: a sealed run of two stations with an alarm, below runs/."""

    def make(home: Path) -> None:
        make_run(home).rename(home / "kept")

    copied(stage, "small", make)
    (stage.folder / "runs").mkdir(exist_ok=True)
    (stage.folder / "kept").rename(stage.folder / "runs" / (text or "run"))


def runs(stage: Stage, text: str) -> None:
    """``runs N``: so many sealed runs of one station, below runs/."""
    errors = [0.5 * (number % 3) for number in range(int(text))]
    copied(stage, f"runs-{text}", lambda home: many_runs(home / "runs", errors))


def joints(stage: Stage, _: str) -> None:
    """runs/joints: a run of ten minutes with a joint each five seconds."""

    def make(home: Path) -> None:
        one_run(home / "runs", 0, rows=6000, joints_until_s=600.0).rename(home / "runs" / "joints")

    copied(stage, "joints", make)


def copy(stage: Stage, text: str) -> None:
    """``copy FROM TO``: a folder."""
    old, new = text.split()
    shutil.copytree(stage.folder / old, stage.folder / new)


def crashed(stage: Stage, _: str) -> None:
    """runs/crashed: a run whose recorder vanished after ten seconds."""

    def make(home: Path) -> None:
        folder, _ = begin(home / "runs", 10.0)
        store = RunJournal(folder, seal_every_s=None)
        store.start()
        fill(store, 10.0)
        store.commit_now()
        vanish(store)
        folder.rename(home / "runs" / "crashed")

    copied(stage, "crashed", make)


def cut_off(stage: Stage, _: str) -> None:
    """runs/cut_off: one that vanished before it had a manifest."""

    def make(home: Path) -> None:
        abandoned(home / "runs").rename(home / "runs" / "cut_off")

    copied(stage, "cut_off", make)


def recording(stage: Stage, _: str) -> None:
    """runs/recording: a run in progress, with ten seconds so far."""
    folder, _ = begin(stage.folder / "runs", 10.0)
    folder = folder.rename(folder.with_name("recording"))
    store = RunJournal(folder, seal_every_s=None)
    store.start()
    fill(store, 10.0)
    store.commit_now()
    stage.at_end.append(lambda: vanish(store))


def captured(stage: Stage, _: str) -> None:
    """runs/captured: a run of ten seconds with a serial capture."""

    def make(home: Path) -> None:
        run = run_in(home, line_text(), duration_s=10.0, wire=True)
        run.rename(run.with_name("captured"))

    copied(stage, "captured", make)


def release(stage: Stage, text: str) -> None:
    """``release 0.1.0``: runs/release, a run that this release sealed."""
    (path,) = (DATA / "releases" / text / "sealed").iterdir()
    shutil.copytree(path, stage.folder / "runs" / "release")


def profile(stage: Stage, text: str) -> None:
    """``profile NAME``: recipe.toml is this one of profiles/recipes."""
    shutil.copy(RECIPES / f"{text}.toml", stage.folder / "recipe.toml")


def not_installed(stage: Stage, text: str) -> None:
    """A package that an extra installs is not there, and no module that needs it is loaded yet."""
    stage.patches.setitem(sys.modules, text, None)
    importing = re.compile(rf"^(from|import) {re.escape(text)}\b", re.MULTILINE)
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if name.startswith("jbclog.") and file and importing.search(Path(file).read_text("utf-8")):
            stage.patches.delitem(sys.modules, name)


def batch_locked(stage: Stage, text: str) -> None:
    """``batch_locked night.toml``: another process runs the batch of this file."""
    path = stage.folder / text
    lock = hold(home_of(Path("runs"), Path(text)), path, "22:00")
    lock.__enter__()
    stage.at_end.append(lambda: lock.__exit__(None, None, None))


def only_run(stage: Stage, text: str) -> None:
    """``only_run runs/NAME``: the only run that is not called so far, under this name."""
    named_runs(stage, Path(text).name)


def named_runs(stage: Stage, text: str) -> None:
    """``named_runs NAME ...``: these names for the runs below runs/, in order of their times."""
    folders = sorted((stage.folder / "runs").glob("20*Z-*"))
    for path, name in zip(folders, text.split(), strict=True):
        path.rename(path.with_name(name))


def emptied(stage: Stage, text: str) -> None:
    """The files that the pattern names have no bytes."""
    for path in stage.folder.glob(text):
        path.write_bytes(b"")


def changed_byte(stage: Stage, text: str) -> None:
    """The last byte of a file, or of the only file that the pattern names, is another."""
    (path,) = stage.folder.glob(text)
    data = path.read_bytes()
    path.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))


def removed(stage: Stage, text: str) -> None:
    for path in list(stage.folder.glob(text)):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


def folder(stage: Stage, text: str) -> None:
    (stage.folder / text).mkdir(parents=True)


def variable(stage: Stage, text: str) -> None:
    """``variable NAME=VALUE`` of the environment."""
    name, _, value = text.partition("=")
    stage.patches.setenv(name, value)


GIVEN: Final[dict[str, Callable[[Stage, str], None]]] = {
    given.__name__: given
    for given in (
        *(
            station,
            recipe,
            edit,
            append,
            encoded,
            bytes_more,
        ),
        *(
            lines_end,
            at_work,
            seconds,
            unplugged,
            silent,
            only_acknowledged,
        ),
        *(
            says,
            always_says,
            cable,
            silent_cable,
            no_ports,
            held_by_run,
        ),
        *(
            open_in_program,
            interrupted,
            run,
            runs,
            joints,
            copy,
        ),
        *(
            crashed,
            cut_off,
            recording,
            captured,
            release,
            profile,
        ),
        *(
            not_installed,
            batch_locked,
            only_run,
            named_runs,
            emptied,
            changed_byte,
        ),
        *(
            removed,
            folder,
            variable,
        ),
    )
}
