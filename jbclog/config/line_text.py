"""The text of a line file, written: what `parse_line` reads again as the same stations."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping

from jbclog.config.line import Replay, StationTable

Described = tuple[StationTable, str]
"""A station and what is said of it in a comment above it, or nothing."""


def line_text(name: str, stations: Iterable[Described], heading: str, replay: Replay | None = None) -> str:
    """The text of a line file. `heading` and what is said of stations become comments."""
    parts = ["\n".join(_station(station, said)) for station, said in stations]
    return f"{line_comment(heading)}[line]\nname = {quoted(name)}\n{_replay(replay)}" + "".join(parts)


def _replay(replay: Replay | None) -> str:
    if replay is None:
        return ""
    tables: dict[str, Mapping[str, float]] = {
        "rate_hz": replay.rate_hz,
        "first_tick": replay.first_tick,
        "first_in_s": replay.first_in_s,
    }
    lines = (f"{key} = {{ {_by_name(values)} }}\n" for key, values in tables.items())
    return f"\n[replay]\nspeed = {replay.speed!r}\n{''.join(lines)}"


def _by_name(values: Mapping[str, float]) -> str:
    return ", ".join(f"{quoted(name)} = {value!r}" for name, value in values.items())


def line_comment(text: str) -> str:
    """The text as comments, line by line."""
    return "".join(f"# {line}\n" for line in _plain(text).splitlines())


def _plain(text: str) -> str:
    """Text that a comment can hold: a control character is no TOML, and a hidden one is refused."""
    return "".join(sign if sign == "\n" or sign.isprintable() else "?" for sign in text)


def _station(station: StationTable, said: str) -> Iterator[str]:
    yield f"\n{line_comment(said)}[[station]]"
    yield from _keys(station)


def station_text(station: StationTable) -> str:
    """One station's table without anything around it."""
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
        yield f"recipe = {quoted(str(station.recipe.absolute()))}"
    if station.rated_power_w is not None:
        yield f"rated_power_w = {station.rated_power_w}"
    yield ""


def quoted(text: str) -> str:
    """A TOML basic string: JSON's escapes are TOML's, but for the one character that JSON leaves alone."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
