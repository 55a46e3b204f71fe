"""The names of one station, listed: what `read` and `write` say when no name is given."""

from __future__ import annotations

from jbclog.app.connection import ask
from jbclog.cli.output import note, tell, tell_json
from jbclog.cli.values import list_facts, list_lines
from jbclog.protocol.commands.family import Family
from jbclog.session.manual.contact import Target, meet
from jbclog.session.manual.names import Kind


def tell_names(target: Target, kind: Kind, *, as_json: bool) -> None:
    """Tell every name that `kind` lets through; a station whose family is "auto" is asked for it."""
    family = target.family or ask(target, meet(target)).family
    if as_json:
        tell_json(list_facts(target.name, family, kind))
        return
    note(_heading(target, family))
    for line in list_lines(family, kind):
        tell(line)


def _heading(target: Target, family: Family) -> str:
    ports = target.ports or family.ports
    known = "the ports that answer" if ports is None else f"port{'s' if len(ports) > 1 else ''} {', '.join(map(str, ports))}"
    return f"{target.name}: {family.title}, {known}. Name, unit, what it belongs to, what may be written, manual:"
