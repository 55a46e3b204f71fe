"""Model names: which the line file may accept, and what it must say where no table knows one.

The manuals print two names, DDR (000) and JTSE (001); every other in `Family.models` is inferred. A station that calls itself
anything else is driven as the line file says with its key `model`, within these bounds: status 00001 is "stand" for a soldering
tool and "on" for hot air, so a name never makes a soldering station of a hot air station, nor the reverse.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import FAMILIES, OMEGA, Family, family_of

HOT_AIR: Final = "JT"
"""How the model names of hot air stations begin (001, 4.9.18)."""


def model_problem(family: Family, model: str) -> str | None:
    """Why a station that calls itself `model` cannot be driven as `family`, or None."""
    if not family.models:
        return f"a station of family {family.name} does not say a model; leave it out"
    is_hot_air, named_so = family.models == (HOT_AIR,), model.upper().startswith(HOT_AIR)
    if named_so and not is_hot_air:
        return f'"{model}" begins with {HOT_AIR}: it is a hot air station, which status 00001 switches on, and no {family.name}'
    if is_hot_air and not named_so:
        return f'"{model}" does not begin with {HOT_AIR}, as the model names of hot air stations do: it is no {family.name}'
    return None


def foreign_reads(family: Family) -> Iterator[Command]:
    """Reads that only stations of another kind than this family's answer."""
    kinds = {one.answered_by_kind: one for one in FAMILIES.values() if one.protocol != OMEGA}
    for names, one in kinds.items():
        if names != family.answered_by_kind:
            yield from (one.commands[name] for name in names)


def accept_line(model: str) -> str:
    """The line of a line file that accepts this name: ``model = "DIE"``."""
    return f'model = "{model}"'


def unknown_model(model: str) -> str:
    """What to write where the family is to be learnt from a name that no table has."""
    return (
        f"it says model {model!r}, which no table has. If you know what it is, name its family in the line file in place of "
        f'"auto", and add {accept_line(model)}'
    )


def other_model(family: Family, model: str) -> str:
    """What to write where the line file's family is not the one that the name proves."""
    told = f"the line file says family {family.name}, the station says model {model}; nothing was written to it. "
    known = family_of(model)
    if model_problem(family, model) is not None:
        right = f' (family = "{known.name}")' if known is not None else ""
        return f"{told}Correct `family`{right}, or the cable"
    return f"{told}Correct `family`, or the cable; if it is a {family.name}, add {accept_line(model)}"


def not_accepted(accepted: str, model: str) -> str:
    """That the station's name is not the one that the line file accepts."""
    return f"the line file accepts model {accepted}, the station says model {model}"
