"""Meanings of the stations' error numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class ErrorTable:
    """Meanings of error numbers. `states` are not faults; `no_tool` is the number for an empty
    port.

    `voids` lists error, signal and reason: during the error the signal has no meaning.
    """

    kind: str
    texts: Mapping[int, str]
    states: frozenset[int] = frozenset()
    warnings: frozenset[int] = frozenset()
    no_tool: int | None = None
    voids: tuple[tuple[int, str, str], ...] = ()

    def text(self, code: int) -> str:
        """Return the meaning of `code`, or the number if it is unknown."""
        return self.texts.get(code, f"unknown {self.kind} error {code}")

    def void(self, code: int | None, signal: str) -> str | None:
        """Return why `signal` has no meaning during the error `code`; None if it has one."""
        if not self.voids:
            return None
        return next(
            (reason for error, name, reason in self.voids if (error, name) == (code, signal)), None
        )


PORT_ERRORS = ErrorTable(
    "port",
    MappingProxyType(
        {
            0: "ok",
            1: "short circuit",
            2: "short circuit, not recoverable; restart the station",
            3: "open circuit",
            4: "no tool",
            5: "tool not accepted",
            6: "detecting the tool",
            7: "stopped: maximum power",
            8: "stopped: overload (MOS)",
            # printed; 0 to 8 are known from real stations over USB, 9 is not
            9: "warning: overload (MOS)",
        }
    ),
    states=frozenset({4, 6}),  # docs/reference/station-commands.md, Port errors
    warnings=frozenset({9}),
    no_tool=4,
)

STATION_ERRORS = ErrorTable(
    "station",
    MappingProxyType(
        {
            0: "ok",
            1: "stopped: transformer overload",
            2: "temperature sensor of the transformer",
            3: "memory",
            4: "mains frequency",
            5: "station model",
            6: "tool controller not connected",
            7: "warning: transformer overload",
        }
    ),
    warnings=frozenset({7}),
)

COMMUNICATION_ERRORS = {
    1: "wrong check byte",
    2: "wrong format",
    3: "value out of range",
    4: "command not accepted",
    5: "Robot mode is off",
    6: "station model unknown",
    255: "undefined",  # docs/reference/contradictions.md, B-54
    99999: "undefined",
}
UNDEFINED_ERRORS = frozenset({255, 99999})
