"""What is printed for UCR alone (manuals 002 and 004)."""

from __future__ import annotations

from jbclog.core.quantities import Choice, Number
from jbclog.protocol.commands.command import Command, Effect, Limits, Scope

FUSE = Choice(("absent", "present"))

UCR = (
    Command("fuse", "FST", Scope.STATION, FUSE, "r", "002 R-FST", note="B-39: garbled row; UCR only"),
    Command(
        "address",
        "SAD",
        Scope.STATION,
        Number(),
        "w",
        "002 W-SAD; 004 WSAD",
        Limits(0, 99, 1),
        Effect.ERASES,
        True,
        note="B-9: 00000 switches addresses off",
    ),
)
