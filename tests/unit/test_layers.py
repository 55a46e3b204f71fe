"""The house's plan: which room may import which, and what may never be imported where."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from imports import Import, imports_of, parsed, room_of, room_of_file

import jbclog

PACKAGE = Path(jbclog.__file__).parent

BOTTOM = "errors clock quantities wire rows effects tape same_port locked cells shown"
MAY_USE = {
    # bottom: of jbclog they import only each other
    **dict.fromkeys(BOTTOM.split(), BOTTOM),
    "locked": f"{BOTTOM} foreign",
    "protocol": "errors",
    "commands": "quantities errors",
    "transport": "errors wire tape",
    "foreign": "errors",
    "recipe": "commands quantities errors foreign wire",
    "station": "protocol commands quantities wire errors effects",
    "scheduler": "commands wire errors",
    "byhand": "safety station commands quantities wire errors effects",
    "finding": "station protocol commands quantities wire errors effects",
    "safety": "station commands quantities effects errors",
    "session": "safety station scheduler recipe commands rows clock effects errors quantities wire",
    "drive": "transport clock effects tape errors",
    "guard": "safety station commands drive transport record clock effects wire errors same_port locked foreign shown",
    "record": "rows tape clock errors same_port locked foreign",
    "sim": "protocol commands quantities wire recipe clock tape errors",
    "judge": "rows errors foreign",
    "spc": "errors",
    "features": "judge rows",
    "episodes": "rows errors",
    "verifying": "record rows errors foreign",
    "odometer": "",
    "audit": "odometer record recipe rows errors cells shown locked foreign",
    "analysis": "record judge episodes features spc rows tape errors foreign",
    "report": "analysis judge judged_again spc record recipe commands rows errors cells shown foreign",
    # top: what puts the rooms together, below the command line
    "outcome": "rows errors",
    "reach": "byhand commands protocol recipe record drive transport clock effects wire errors",
    "counting": "audit odometer analysis reach byhand commands quantities record verifying drive transport rows effects same_port "
    "errors",
    "auditing": "audit odometer counting reach recipe record errors",
    "line_safe": "reach byhand commands recipe record guard drive errors",
    "search": "finding record drive transport clock wire errors",
    "found_line": "finding recipe transport",
    "doctor": "search finding recipe record transport commands",
    "plan": f"{BOTTOM} commands recipe scheduler session",
    "port_reading": "features judge rows",
    "joint_evidence": "port_reading record features judge rows",
    "judged_again": "joint_evidence recipe record judge rows errors foreign",
    "dossier": f"{BOTTOM} plan outcome session record judge joint_evidence episodes verifying",
    "guarding": "guard rows",
    "unit_feed": "drive rows",
    "goals": "unit_feed rows",
    "joint_counting": "analysis errors",
    "conduct": f"{BOTTOM} dossier guarding goals unit_feed guard plan outcome session drive transport record",
    "replaying": "dossier plan recipe session drive record sim clock rows effects tape errors",
    "job": "conduct dossier drive plan",
    "batch": "recipe record commands rows errors locked foreign",
    "foreman": "batch job plan dossier drive record recipe outcome session rows errors foreign",
    "jbclog": "analysis errors",  # public names, loaded when they are used
}
"""Room -> the rooms that it may import. `cli` may import all; a room that is not here must be given a row."""

ALL = {*MAY_USE, "cli"}
KNOWS_NO_IO = ["protocol", "commands", "quantities", "station", "safety", "scheduler", "session", "byhand", "finding", "effects"]
NO_IO = ["serial", "socket", "threading", "time", "pandas", "pyarrow", "asyncio", "select", "selectors", "subprocess", "sqlite3"]
HEAVY = ("pandas", "matplotlib", "jinja2")
ONLY_IN = {
    "serial": {"transport"},
    "pandas": {"analysis", "report"},
    "jinja2": {"audit", "report"},
    "tomllib": {"recipe", "record"},
}
SIM_IN_CLI = {"cli/sim.py", "cli/demo.py", "cli/replay.py"}


def faults(package: Path) -> list[str]:
    """Every import below `package` that the plan forbids, as a sentence."""
    return [f"{at.place}: {text}" for path in sorted(package.rglob("*.py")) for at, text in _faults_of_file(path, package)]


def _faults_of_file(path: Path, package: Path) -> Iterator[tuple[Import, str]]:
    room, file = room_of_file(path, package), path.relative_to(package).as_posix()
    for at in imports_of(path, package):
        top = at.module.split(".")[0]
        if top == "jbclog":
            if not _may_use(room, at.module, file):
                yield at, f"{room} may not import {at.module}"
        elif room in KNOWS_NO_IO and top in NO_IO:
            yield at, f"{room} does no I/O and may not import {top}"
        elif room not in ONLY_IN.get(top, ALL):
            yield at, f"only {' and '.join(sorted(ONLY_IN[top]))} may import {top}"
        elif at.module.startswith("matplotlib.pyplot"):
            yield at, "pyplot's state is global"


def _may_use(room: str, module: str, file: str) -> bool:
    wanted = room_of(module)
    if wanted == room or wanted == "__version__":
        return True
    if room == "cli":
        return wanted in ALL and (wanted != "sim" or file in SIM_IN_CLI)
    return wanted in MAY_USE.get(room, "").split()


def test_every_room_imports_only_what_the_plan_lets_it() -> None:
    assert faults(PACKAGE) == []


def test_every_room_has_its_place_in_the_plan() -> None:
    rooms = {room_of_file(path, PACKAGE) for path in PACKAGE.rglob("*.py")}
    assert rooms == ALL


def test_the_plan_has_no_cycle_above_the_bottom() -> None:
    above = {room: set(used.split()) - set(BOTTOM.split()) for room, used in MAY_USE.items() if room not in BOTTOM.split()}
    while above:
        free = {room for room, used in above.items() if not used & set(above)}
        assert free, f"these import each other in a circle: {sorted(above)}"
        above = {room: used for room, used in above.items() if room not in free}


@pytest.mark.parametrize(
    ("file", "text", "fault"),
    [
        ("protocol/frame.py", "from jbclog.commands.robot import ROBOT", "protocol may not import jbclog.commands.robot.ROBOT"),
        ("session/run.py", "def f():\n    import time", "session does no I/O and may not import time"),
        ("station/robot.py", "from threading import Lock", "station does no I/O and may not import threading"),
        ("record/live.py", "import pandas as pd", "only analysis and report may import pandas"),
        ("drive/reactor.py", "from serial import Serial", "only transport may import serial"),
        ("plan.py", "from jbclog.sim.virtual import VirtualStation", "plan may not import jbclog.sim.virtual.VirtualStation"),
        ("cli/run.py", "from jbclog import sim", "cli may not import jbclog.sim"),
        ("report/figure.py", "from matplotlib import pyplot", "pyplot's state is global"),
        ("cellar.py", "from jbclog import errors", "cellar may not import jbclog.errors"),
        ("cli/demo.py", "from jbclog.sim.process import SimProcess", None),
        ("session/run.py", "from jbclog.station.robot import Station", None),
    ],
)
def test_a_forbidden_import_is_found(tmp_path: Path, file: str, text: str, fault: str | None) -> None:
    made_up = tmp_path / "jbclog" / file
    made_up.parent.mkdir(parents=True)
    made_up.write_text(text, encoding="utf-8")
    line = text[: text.find("import")].count("\n") + 1
    assert faults(tmp_path / "jbclog") == ([f"{file}:{line}: {fault}"] if fault else [])


# -- what each room says of itself ------------------------------------------------------------------------------------------

PARTS = ("Owns:", "Never:", "May use:", "Start reading:")
PACKAGES = sorted(path for path in PACKAGE.glob("*/__init__.py"))


def docstring(path: Path) -> str:
    return ast.get_docstring(parsed(path)) or ""


@pytest.mark.parametrize("path", PACKAGES, ids=lambda path: path.parent.name)
def test_a_room_says_what_it_owns_and_where_to_start_reading(path: Path) -> None:
    text = docstring(path)
    places = [text.find(f"\n{part}") for part in PARTS]
    assert -1 not in places, f"{path.parent.name} lacks one of {PARTS}"
    assert places == sorted(places)
    for name in re.findall(r"`(\w+\.py)`", text):
        assert (path.parent / name).is_file(), f"{path.parent.name} sends its reader to {name}, which is not there"


@pytest.mark.parametrize("path", [path for path in PACKAGES if path.parent.name != "cli"], ids=lambda path: path.parent.name)
def test_a_room_says_the_same_as_the_plan(path: Path) -> None:
    told = docstring(path).partition("May use:")[2].partition("Start reading:")[0]
    rooms = {name for name in re.findall(r"`(\w+)`", told) if name in ALL}
    assert rooms == set(MAY_USE[path.parent.name].split())


def test_every_file_begins_with_what_it_is() -> None:
    assert [path.name for path in PACKAGE.rglob("*.py") if not docstring(path)] == []


# -- what really gets loaded ------------------------------------------------------------------------------------------------


def loaded_by(statement: str, *names: str) -> set[str]:
    """Which of the modules `names` are loaded in a fresh Python after `statement`."""
    code = f"import sys\n{statement}\nprint(*[name for name in {names!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=200)
    return set(done.stdout.split())


def test_importing_jbclog_is_light() -> None:
    assert loaded_by("import jbclog", *HEAVY, "numpy", "pyarrow", "pydantic", "serial", "typer") == set()


def test_public_names_load_what_they_need_and_no_more() -> None:
    assert loaded_by("import jbclog; jbclog.LinkError", *HEAVY, "pyarrow", "serial") == set()
    assert loaded_by("import jbclog; jbclog.open_run", "pandas", "matplotlib", "scipy") == {"pandas"}, (
        "scipy takes a second to load"
    )


def test_help_is_light() -> None:
    assert loaded_by("import jbclog.cli", *HEAVY, "numpy", "pyarrow", "pydantic", "serial", "sqlite3", "asyncio") == set()


def test_the_recorder_loads_no_heavy_room() -> None:
    path = "import jbclog.cli.run, jbclog.cli.progress, jbclog.plan, jbclog.conduct, jbclog.record.seal"
    assert loaded_by(path, *HEAVY, "scipy", "jbclog.features", "jbclog.sim", "jbclog.analysis", "jbclog.report", "rich") == set()


def test_joints_are_looked_for_at_the_end_of_a_run_without_the_heavy_rooms() -> None:
    assert loaded_by("import jbclog.joint_evidence", *HEAVY, "jbclog.analysis", "jbclog.report") == set()
