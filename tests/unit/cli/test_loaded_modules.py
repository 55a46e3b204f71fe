"""What a command has loaded when it has printed, or, for a run, when its first byte is due.

A module that creeps in costs every start: it belongs on these lists, or is imported where it is
needed.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.records.small_run import make_run

LINE = """
[line]
name = "bench"
[[station]]
name = "dde-1"
url = "nowhere"
family = "dde"
ports = [1]
"""
RECIPE = Path(__file__).parents[3] / "profiles" / "recipes" / "sn100c-tht.toml"
TELL = """
import gc, os, pathlib, sys
from jbclog.record import port_owner
from jbclog.transport.reactor import Reactor
port_owner.open_files = lambda process: []  # the journal of another run on this machine is read
def tell(*_):
    pathlib.Path("modules").write_text(" ".join([*sys.modules, f"collects={gc.isenabled()}"]))
    os._exit(0)
Reactor.run = tell
"""
SHOWN = """
import atexit, gc, pathlib, sys
def tell():
    passes = sum(one["collections"] for one in gc.get_stats()) - before
    built = [f"built={name}" for name in models() if models()[name].__pydantic_complete__]
    pathlib.Path("modules").write_text(" ".join([*sys.modules, f"passes={passes}", *built]))
def models():
    files = [sys.modules[name] for name in sys.modules if name.startswith("jbclog.config.")]
    found = [one for file in files for one in vars(file).values()]
    return {one.__name__: one for one in found if "__pydantic_complete__" in dir(one)}
before = sum(one["collections"] for one in gc.get_stats())
atexit.register(tell)
"""
MAIN = "from jbclog.cli import main; main()"

COMMAND_LINE = {"typer", "click", "shellingham", "annotated_doc", "typing_extensions"}
MODELS = {"pydantic", "pydantic_core", "annotated_types", "typing_inspection"}
ARROW = {"pyarrow", "numpy", "cloudpickle", "dateutil", "six", "msgspec"}
MADE_BY_CYTHON = {"cython_runtime"}
OF_THE_SYSTEM = {"sitecustomize", "usercustomize"}  # Debian's Python brings one
# reads mails and archives; pydantic would load it to look for plug-ins
OF_PACKAGES = {"email", "importlib.metadata", "zipfile"}
MEASURED_BY = {"coverage", "$coverage"}  # in child processes, too, where coverage is measured

PLAN = {
    *("app", "app.run", "app.run.options", "app.run.plan"),
    *("cli", "cli.app", "cli.front_page", "cli.help", "cli.loading", "cli.names", "cli.options"),
    *("cli.output", "cli.streams", "config", "config.line", "config.load_recipe", "config.recipe"),
    *("config.recipe_sections", "config.recipe_settings", "config.schema", "config.sim_spec"),
    *("core", "core.children", "core.disk_space", "core.encodings", "core.errors", "core.files"),
    "core.operating_system",
    *(
        "core.toml",
        "core.toml_advice",
        "core.goal",
        "core.outcome",
        "core.quantities",
        "core.serial_line",
        "core.states",
    ),
    *("core.text", "protocol", "protocol.commands", "protocol.commands.command"),
    *("protocol.commands.defaults", "protocol.commands.error_tables", "protocol.commands.family"),
    *("protocol.commands.feeder", "protocol.commands.hotair", "protocol.commands.omega"),
    *("protocol.commands.ranges", "protocol.commands.robot"),
    *("protocol.commands.signals", "protocol.commands.status", "session", "session.rates"),
    "session.scheduler",
}
RUN = PLAN | {
    *("analysis", "analysis.alarms", "analysis.alarms.live", "analysis.alarms.port_watch"),
    *("analysis.alarms.state_machine", "analysis.rules_number"),
    *("app.run.goals", "app.run.recorder", "app.run.run_record", "app.run.runner"),
    *(
        "app.run.identities",
        "app.run.tasks",
        "app.run.unit_feed",
        "cli.progress",
        "cli.run",
        "cli.terminal",
    ),
    *(
        "core.clock",
        "core.chain",
        "core.durable_files",
        "core.json_files",
        "core.line_file",
        "core.io_requests",
    ),
    *("core.locks", "core.rows"),
    *("guard", "guard.action_log", "guard.lease", "guard.open_leases", "guard.supervisor"),
    *(
        "guard.blind_orders",
        "guard.continuity",
        "guard.identifying",
        "guard.takeover",
        "guard.watch",
        "maintenance",
        "maintenance.verification",
    ),
    *("protocol.client", "protocol.client.confirmed_reads", "protocol.client.dialogue"),
    "protocol.client.question",
    *("protocol.client.interface", "protocol.client.make", "protocol.client.omega"),
    *("protocol.client.robot", "protocol.client.timing", "protocol.commands.decisions"),
    *("protocol.commands.plugged_hours", "protocol.frame", "protocol.omega"),
    *("record", "record.chains", "record.folder", "record.frames", "record.guard_actions"),
    *("record.run_journal", "record.manifest", "record.old_names"),
    # those of port_owner where another run goes on here
    *("record.damage", "record.journal_reader", "record.part_chain", "record.port_owner"),
    *("record.row_batches", "record.schema", "record.seal_child", "record.segments"),
    *("session.run", "session.run.context", "session.run.identify", "session.run.identity"),
    *("session.run.link_loss", "session.run.pace", "session.run.permit"),
    *("session.run.countdown", "session.run.counters", "session.run.omega_states"),
    "session.run.watch",
    *("session.run.alarms", "session.run.apply", "session.run.condition", "session.run.outage"),
    *("session.run.lateness", "session.run.readings", "session.run.safe"),
    *("session.run.log", "session.run.new_tool", "session.run.port_rows"),
    *("session.run.reconnection", "session.run.row_values", "session.run.sampling"),
    *("session.run.signal_read", "session.run.state", "session.run.task"),
    *("session.run.setting", "session.run.station_run", "session.safety"),
    "session.setting_write",
    *(
        "session.safety.blind",
        "session.safety.cooling",
        "session.safety.orders",
        "session.safety.secure",
    ),
    *("session.safety.time_budget", "session.safety.tools"),
    *("transport", "transport.blocking", "transport.cpu_limit", "transport.device"),
    "transport.rfc2217",
    *("transport.event_loop", "transport.opening", "transport.port", "transport.port_thread"),
    *("transport.reactor", "transport.session_runner"),
    *("transport.signals", "transport.start_barrier", "transport.system_ports"),
    *("transport.typed_lines",),
}
DRAWN = {
    *("PIL", "contourpy", "cycler", "fontTools", "kiwisolver", "matplotlib", "mpl_toolkits"),
    *("packaging", "pyparsing", "pandas", "jinja2", "markupsafe"),
    *("typst", "charset_normalizer", "numexpr", "bottleneck"),
}


def loaded(before: str, words: list[str], folder: Path) -> set[str]:
    """The modules that the command has loaded."""
    subprocess.run(
        [sys.executable, "-c", f"{before}{MAIN}", *words],
        capture_output=True,
        check=True,
        cwd=folder,
        env=os.environ | {"JBCLOG_NO_DERIVED": "1"},
    )
    return set((folder / "modules").read_text().split())


def own(modules: set[str]) -> set[str]:
    return {name.removeprefix("jbclog.") for name in modules if name.startswith("jbclog.")}


def foreign(modules: set[str]) -> set[str]:
    packages = {name.partition(".")[0] for name in modules if "=" not in name}
    packages -= sys.stdlib_module_names | MEASURED_BY | OF_THE_SYSTEM
    return {name for name in packages if not name.startswith("_")} - MADE_BY_CYTHON - {"jbclog"}


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    line = tmp_path_factory.mktemp("line") / "line.toml"
    line.write_text(LINE)
    return [str(RECIPE), "--line", str(line)]


def test_plan(words: list[str], tmp_path: Path) -> None:
    modules = loaded(SHOWN, ["plan", *words], tmp_path)
    assert own(modules) - {"cli.plan"} - PLAN == set()
    assert foreign(modules) - COMMAND_LINE - MODELS == set()
    assert OF_PACKAGES & modules == set()
    (passes,) = (int(one.removeprefix("passes=")) for one in modules if one.startswith("passes="))
    built = {one.removeprefix("built=") for one in modules if one.startswith("built=")}
    assert built == {"LineTables", "StationTable", "RecipeTables"}  # not each table within them
    assert passes < 12  # of the garbage collector, before and after the plan; 59 if it never rests


def test_a_run_when_its_first_byte_is_due(words: list[str], tmp_path: Path) -> None:
    modules = loaded(TELL, ["run", *words], tmp_path)
    assert "collects=True" in modules  # while it loads it does not
    assert "app.run.recorder" in own(modules)
    assert own(modules) - RUN == set()
    assert foreign(modules) - COMMAND_LINE - MODELS - ARROW - {"serial"} == set()
    assert {"pyarrow.compute", "pyarrow.parquet", "pyarrow.dataset"} & modules == set()
    assert "serial.tools.list_ports" not in modules
    assert OF_PACKAGES & modules == set()


def test_report(tmp_path: Path) -> None:
    modules = loaded(SHOWN, ["report", str(make_run(tmp_path, 20.0))], tmp_path)
    # its joints were censored
    assert foreign(modules) - COMMAND_LINE - MODELS - ARROW - DRAWN - {"scipy"} == set()
    assert {"rich", "serial", "matplotlib.pyplot", "pandas.plotting._matplotlib"} & modules == set()
    assert "mpl_toolkits.mplot3d.axes3d" not in modules
    forbidden = ("session", "transport", "sim", "live", "app", "guard", "protocol.client")
    forbidden += ("config.load_recipe", "config.recipe")  # the run has its verdict
    assert [name for name in own(modules) if name.startswith(forbidden)] == []


def test_a_command_has_matplotlib_without_its_lists_of_properties() -> None:
    asks = "from matplotlib.lines import Line2D; print(Line2D.set.__doc__)"
    load = "from jbclog.cli.loading import drawing\nwith drawing(): import matplotlib.lines\n"
    said = [
        subprocess.run(
            [sys.executable, "-c", before + asks], capture_output=True, check=True, text=True
        ).stdout
        for before in ("", load)
    ]
    assert "linewidth" in said[0]
    assert said[1] == "None\n"
