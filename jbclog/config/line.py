"""Read and write line files: the stations and their ports."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator
from ipaddress import ip_address
from pathlib import Path, PurePosixPath
from typing import Annotated, Final
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, PlainValidator

from jbclog.config.schema import (
    NAME_ALLOWED,
    CheckedFile,
    FromList,
    Name,
    Table,
    read_file,
    read_table,
    said,
    shared,
    shown,
    unknown,
    without_case,
)
from jbclog.config.sim_spec import SimSpec
from jbclog.core.errors import Problem, Problems
from jbclog.core.serial_line import BAUDRATES, SCHEMES, LineFormat, scheme_of
from jbclog.core.toml import KeyPath, TomlText, parse, read_text, shortened
from jbclog.protocol.commands.family import FAMILIES, OMEGA, Family, model_problem

_WINDOWS_PORT = re.compile(r"COM\d{1,3}|\\\\\.\\.+", re.IGNORECASE)


def is_path(url: str) -> bool:
    """Return True if the URL is a device path: no scheme, no COM port."""
    return "://" not in url and not _WINDOWS_PORT.fullmatch(url)


def checked_url(value: str) -> str:
    """Validate a device path or pyserial URL and return it unchanged; a relative path must stay
    below the line file's folder.
    """
    if "://" not in value:
        path = PurePosixPath(value)
        if ".." in path.parts and not path.is_absolute():
            raise said(
                f"{shown(value)} is not allowed; a relative path stays below the line file's folder"
            )
        return value
    problem = url_problem(value)
    if problem:
        raise said(problem)
    return value


def url_problem(value: str) -> str | None:
    """Return what is wrong with a URL that has a scheme; None for a valid URL or a path."""
    scheme = scheme_of(value)
    if "://" not in value:
        return None
    if scheme not in SCHEMES:
        return f"the kind of port {shown(scheme)} is {unknown(scheme, list(SCHEMES))}"
    if scheme in ("socket", "rfc2217") and not _has_host_and_port(value):
        return f"{shown(value)} is not allowed; {scheme}://HOST:PORT"
    return None


def tcp_port(url: str) -> str | None:
    """Return ``host:port`` of socket:// and rfc2217:// URLs, with one name for this machine; None
    for other URLs. Resolves no names.
    """
    if scheme_of(url) not in ("socket", "rfc2217") or not _has_host_and_port(url):
        return None
    parts = urlsplit(url)
    host = parts.hostname or ""
    return f"{'localhost' if is_this_host(host) else host}:{parts.port}"


def is_this_host(host: str) -> bool:
    """Return True if the host is certainly this machine."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def _has_host_and_port(url: str) -> bool:
    try:
        parts = urlsplit(url)
        return bool(parts.hostname) and bool(parts.port)
    except ValueError:
        return False


AUTO: Final = "auto"
LONGEST_MODEL: Final = 16
IS_A_RECIPE: Final = "this is a recipe; a line file has [line] and a [[station]] for each station"
ONE_EACH: Final = (
    "; the manuals print RS-232, which is point to point: one port and one station, whatever their"
    " addresses. Connect the other station to a port or an adapter of its own, and name that"
)
_DRIVEN: Final = ", ".join((*FAMILIES, AUTO))


def _address(value: object) -> int | None:
    if value is False:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= 99:
        raise said(f"{shown(value)} is not allowed; 1 to 99, or false for frames without addresses")
    return value


def _family(name: str) -> str:
    if name != AUTO and name not in FAMILIES:
        raise said(f"{shown(name)} is {unknown(name, [*FAMILIES, AUTO])}")
    return name


def _model(name: str) -> str:
    """Return the name in the form R-SMN reports it, without leading blanks."""
    bare = name.strip(" ")
    if not (1 <= len(bare) <= LONGEST_MODEL and bare.isascii() and bare.isprintable()):
        raise said(
            f"{shown(name)} is not allowed; 1 to {LONGEST_MODEL} printable characters, as the"
            " station gives its model"
        )
    return bare


def _baudrate(value: int) -> int:
    if value not in BAUDRATES:
        raise said(f"{value} is not allowed; one of {', '.join(map(str, BAUDRATES))}")
    return value


def _format(value: str) -> str:
    LineFormat(format=value)
    return value


def _in_order(ports: tuple[int, ...]) -> tuple[int, ...]:
    if len(set(ports)) != len(ports):
        raise said(f"{list(ports)} names a port twice")
    return tuple(sorted(ports))


PortNumber = Annotated[int, Field(ge=1, le=4)]


class StationTable(Table):
    """A table `[[station]]`."""

    name: Name = Field(description=NAME_ALLOWED)
    url: Annotated[str, AfterValidator(checked_url)] = Field(
        min_length=1,
        max_length=1024,
        description="a device path, socket://HOST:PORT or rfc2217://HOST:PORT",
    )
    family: Annotated[str, AfterValidator(_family)] = Field(description=f"one of {_DRIVEN}")
    model: Annotated[str, AfterValidator(_model)] | None = Field(
        None, description="the model name that the station gives, driven as `family` says"
    )
    baudrate: Annotated[int, AfterValidator(_baudrate)] = Field(
        19200, description="bits per second, default 19200 (omega 9600)"
    )
    format: Annotated[str, AfterValidator(_format)] = Field(
        "8N1", description="a line format such as 8N1, 8E1 or 8O2"
    )
    address: Annotated[int | None, PlainValidator(_address)] = Field(
        1, description="1 to 99, or false for frames without addresses"
    )
    ports: Annotated[tuple[PortNumber, ...], FromList, AfterValidator(_in_order)] | None = Field(
        None, min_length=1, max_length=4, description="a list of ports from 1 to 4"
    )
    turnaround_ms: float | None = Field(
        None, ge=0, le=5000, description="milliseconds from 0 to 5000"
    )
    recipe: Path | None = Field(
        None, strict=False, description="a recipe file's path, from the line file's folder"
    )
    rated_power_w: float | None = Field(None, gt=0, le=10_000, description="watts, more than 0")
    sim: SimSpec | None = Field(None, description="a table that describes the virtual station")


class StationSpec(StationTable):
    """One control unit on one serial link.

    `url` and `recipe` are absolute if they are paths; `written_url` is the URL as the file has it.
    `address` None: frames without addresses. `ports` None: those of the family.
    """

    written_url: str = ""

    @property
    def line_format(self) -> LineFormat:
        return LineFormat(self.baudrate, self.format)

    @property
    def is_device(self) -> bool:
        """True if the URL is a device path."""
        return is_path(self.url)

    @property
    def is_relative(self) -> bool:
        """True if the file's device path is relative to the file's folder (virtual stations)."""
        return is_path(self.written_url) and not Path(self.written_url).is_absolute()


class LineTable(Table):
    name: Name = Field(description=NAME_ALLOWED)


class LineTables(Table):
    line: LineTable = Field(description='a table with the line\'s name: [line] name = "bench-3"')
    station: Annotated[tuple[dict[str, object], ...], FromList] = Field(
        min_length=1, description="at least one table [[station]] with name, url and family"
    )


class Line(CheckedFile):
    """The stations of one recorder in file order, and the file's text."""

    name: str
    stations: tuple[StationSpec, ...]

    def station(self, name: str) -> StationSpec:
        """Return a station by name. Raises KeyError."""
        return {station.name: station for station in self.stations}[name]


def load_line(path: Path) -> Line:
    """Read a line file. Raises Problems with all its mistakes."""
    return parse_line(read_text(path), path)


def parse_line(text: str, path: Path) -> Line:
    """Parse a line file; relative paths are relative to the folder of `path`."""
    source = parse(text, str(path))
    if "recipe" in source.tables and not {"line", "station"} & source.tables.keys():
        raise Problems([Problem(source.file, None, "", IS_A_RECIPE)])
    tables, problems, _ = read_file(LineTables, source)
    stations = [
        _read_station(source, place, table, problems) for place, table in source.rows("station")
    ]
    problems += _between_stations(source, path)
    if problems or tables is None:
        raise Problems(shortened(problems))
    found = tuple(_resolved(station, path) for station in stations if station is not None)
    return Line.model_construct(name=tables.line.name, stations=found, source=source)


def _read_station(
    source: TomlText, place: int, table: dict[str, object], problems: list[Problem]
) -> StationTable | None:
    at: KeyPath = ("station", place)
    station, wrong, _ = read_table(StationTable, source, at, table)
    problems += wrong
    family = FAMILIES.get(str(table.get("family")))
    problems += _accepted_model(source, at, table, family)
    if family is not None:
        problems += _within_family(source, at, family, table.get("ports"))
        problems += _without_addresses(source, at, family, table.get("address", False))
    return station


def _accepted_model(
    source: TomlText, at: KeyPath, table: dict[str, object], family: Family | None
) -> Iterator[Problem]:
    """Yield a problem if the family does not include the model."""
    model = table.get("model")
    if not isinstance(model, str):
        return
    if table.get("family") == AUTO:
        yield source.problem(
            (*at, "model"), 'is driven as a family says: name that family in place of "auto"'
        )
    elif family is not None and (problem := model_problem(family, model.strip(" "))) is not None:
        yield source.problem((*at, "model"), problem)


def _without_addresses(
    source: TomlText, at: KeyPath, family: Family, address: object
) -> Iterator[Problem]:
    if family.protocol == OMEGA and isinstance(address, int) and not isinstance(address, bool):
        yield source.problem(
            (*at, "address"), f"the frames of family {family.name} have no addresses; leave it out"
        )


def _within_family(
    source: TomlText, at: KeyPath, family: Family, ports: object
) -> Iterator[Problem]:
    """Yield problems of ports that the family lacks."""
    if family.ports is None or not isinstance(ports, list):
        return
    for place, port in enumerate(ports):
        if port in (1, 2, 3, 4) and port not in family.ports:
            allowed = ", ".join(map(str, family.ports))
            yield source.problem(
                (*at, "ports", place),
                f"the family {family.name} has no port {port}; it has {allowed}",
            )


def _between_stations(source: TomlText, path: Path) -> Iterator[Problem]:
    """Yield names and ports used by two stations."""
    tables = list(source.rows("station"))
    names = [(place, without_case(table.get("name"))) for place, table in tables]
    urls = [(place, _same_port(table.get("url"), path)) for place, table in tables]
    yield from shared(source, "station", "name", names, "is the name of two stations")
    yield from shared(source, "station", "url", urls, "is the port of two stations", ONE_EACH)


def _same_port(url: object, path: Path) -> object:
    """Return a key that is equal for URLs of the same port: follows links, ignores options of TCP
    URLs.
    """
    if not isinstance(url, str) or not url:
        return url
    if not is_path(url):
        return tcp_port(url) or url
    try:
        return os.path.realpath(_folder(path) / url)
    except (OSError, ValueError):  # not a possible file name
        return url


def _folder(path: Path) -> Path:
    return path.absolute().parent


def _resolved(table: StationTable, path: Path) -> StationSpec:
    """Return the station with absolute paths and its family's defaults."""
    folder, family = _folder(path), FAMILIES.get(table.family)
    values = {name: getattr(table, name) for name in StationTable.model_fields}
    values["url"] = str(folder / table.url) if is_path(table.url) else table.url
    values["recipe"] = None if table.recipe is None else folder / table.recipe
    if family is not None and "baudrate" not in table.model_fields_set:
        values["baudrate"] = family.baudrate
    if family is not None and family.protocol == OMEGA:
        values["address"] = None
    return StationSpec.model_construct(**values, written_url=table.url)


Described = tuple[StationTable, str]
"""A station, and the comment above it, or ""."""


def line_text(name: str, stations: Iterable[Described], heading: str) -> str:
    """Format a line file that `parse_line` reads back as the same stations; texts become
    comments.
    """
    parts = ["\n".join(_station(station, said)) for station, said in stations]
    return f"{line_comment(heading)}[line]\nname = {quoted(name)}\n{''.join(parts)}"


def line_comment(text: str) -> str:
    """Format the text as comment lines."""
    return "".join(f"# {line}\n" for line in _plain(text).splitlines())


def _plain(text: str) -> str:
    """Remove control and invisible characters, which a TOML comment must not contain."""
    return "".join(sign if sign == "\n" or sign.isprintable() else "?" for sign in text)


def _station(station: StationTable, said: str) -> Iterator[str]:
    yield f"\n{line_comment(said)}[[station]]"
    yield from _keys(station)


def station_text(station: StationTable) -> str:
    """Format one station as a `[[station]]` table."""
    return "\n".join(("[[station]]", *_keys(station)))


def _keys(station: StationTable) -> Iterator[str]:
    yield f"name = {quoted(station.name)}"
    yield f"url = {quoted(station.url)}"
    yield f"family = {quoted(station.family)}"
    if station.model is not None:
        yield f"model = {quoted(station.model)}"
    yield f"baudrate = {station.baudrate}"
    yield f"format = {quoted(station.format)}"
    yield f"address = {'false' if station.address is None else station.address}"
    if station.ports is not None:
        yield f"ports = {list(station.ports)}"
    if station.turnaround_ms is not None:
        yield f"turnaround_ms = {station.turnaround_ms}"
    if station.recipe is not None:
        yield f"recipe = {quoted(str(station.recipe))}"
    if station.rated_power_w is not None:
        yield f"rated_power_w = {station.rated_power_w}"
    yield ""


def quoted(text: str) -> str:
    """Format a TOML basic string: JSON's escapes, plus one for DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
