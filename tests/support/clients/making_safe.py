"""`secure` against what a test puts at the end of a cable, pulled wish by wish on a clock that
jumps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from support.product import (
    FAMILIES,
    SIM_WORKING,
    AirModel,
    Ask,
    IoResult,
    LineFormat,
    LinkError,
    Listen,
    Peer,
    Reopen,
    Request,
    SafetyTask,
    Station,
    Steps,
    ToolSafety,
    VirtualStation,
    Wait,
    parse_line,
    pull,
    send,
    throw,
)

ASKED_AT = 100.0


def station(family: str = "dde", tools: tuple[int, ...] = (1, 2), sim: str = "") -> VirtualStation:
    """One with these ports' tools at work, switched on long ago."""
    plugged = ", ".join(
        f"{port} = {2 if port in tools else 0}" for port in FAMILIES[family].ports or (1, 2)
    )
    text = (
        '[line]\nname = "x"\n[[station]]\nname = "s"\nurl = "s"\nfamily ='
        f' "{family}"\n[station.sim]\ntools = {{{plugged}}}\n{sim}'
    )
    made = VirtualStation(parse_line(text, Path("line.toml")).stations[0], now=0.0)
    if isinstance(made.device.face, AirModel):
        made.device.face.station.order((0, 0, 0, 0, 1))
        return made
    for port in made.plant.ports.values():
        if port.tool:
            port.order(SIM_WORKING, False)
    made.advance_to(ASKED_AT)
    return made


class Silent:
    """Takes everything and says nothing."""

    def __init__(self) -> None:
        self.questions: dict[str, float] = {}  # and when each was first heard

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        self.questions.setdefault(text_of(data), now)
        return []

    def is_unplugged(self, now: float) -> bool:
        return False


def text_of(frame: bytes) -> str:
    """A question without its frame and addresses."""
    return frame[5:-2].decode()


@dataclass
class Cable:
    """A cable with `end` at it. `before` is told each question before it goes out, and may pull the
    cable or change the end.
    """

    end: Peer
    before: Callable[[str], object] = lambda text: None
    is_out: bool = False
    opens: Callable[[], object] = lambda: None
    now: float = ASKED_AT
    coming: list[tuple[float, bytes]] = field(default_factory=list)

    def pull(self, steps: Steps[None]) -> None:
        """Do as a driver does until they are over."""
        try:
            request = pull(steps)
            while True:
                try:
                    heard = self._do(request)
                except LinkError as error:
                    request = throw(steps, error)
                else:
                    request = send(steps, heard)
        except StopIteration:
            return

    def _do(self, request: Request) -> IoResult:
        if isinstance(request, Reopen):
            self.coming = []
            self.opens()
        if isinstance(request, Ask):
            self.before(text_of(request.data))
        if self.is_out and not isinstance(request, Wait):
            raise LinkError("the cable is out")
        if isinstance(request, Reopen):
            return IoResult(self.now, b"", self.now)
        if isinstance(request, Ask):
            self.coming = [
                (reply[0], reply[1]) for reply in self.end.receive(request.data, self.now)
            ]
            return self._next(self.now + request.patience_s)
        return self._next(request.until) if isinstance(request, Listen) else self._waited(request)

    def _next(self, until: float) -> IoResult:
        sent = self.now
        if not self.coming or self.coming[0][0] > until:
            self.now = max(self.now, until)
            return IoResult(self.now, b"", sent)
        self.now, data = self.coming.pop(0)
        return IoResult(self.now, data, sent)

    def _waited(self, request: Wait) -> IoResult:
        self.now = max(self.now, request.until)
        return IoResult(self.now, b"", self.now)


class FloodedCable(Cable):
    """One that brings a kilobyte of copies of a frame every 50 ms, whatever is asked, for so many
    seconds.
    """

    def __init__(
        self, end: VirtualStation, frame: bytes, seconds: float = 99.0, *, is_out: bool = False
    ) -> None:
        super().__init__(end, is_out=is_out)
        self._copies = (frame * 1000)[:1024]
        self._until = ASKED_AT + seconds
        self._next_at = ASKED_AT

    def begin_at(self, at: float) -> None:
        """It floods from then on only."""
        self._next_at = at

    def _next(self, until: float) -> IoResult:
        copies_at = max(self._next_at, self.now)
        answer_at = self.coming[0][0] if self.coming else until
        if copies_at > min(answer_at, until, self._until):
            return super()._next(until)
        sent, self.now = self.now, copies_at
        self._next_at = copies_at + 0.05
        return IoResult(self.now, self._copies, sent)

    def _waited(self, request: Wait) -> IoResult:
        begun, end = max(self._next_at, self.now), max(request.until, self.now)
        came = self._copies * (1 + int((end - begun) / 0.05)) if begun <= end < self._until else b""
        return super()._waited(request)._replace(data=came)


def task(
    *ports: int,
    family: str = "dde",
    feeds: bool = False,
    spare: bool = False,
    is_proven: bool = True,
    wanted: str = "stand",
    suction: bool | None = False,
) -> SafetyTask:
    """Put these tools in stand, or what is `wanted`; the model's name proves who is there."""
    client = Station(LineFormat())
    client.turnaround_s = 0.002  # it has been spoken to before
    made = FAMILIES[family]

    async def prove() -> bool:
        return made.proves(str(await client.read(made.commands["model"])))

    tools = [ToolSafety(port, suction) for port in ports]
    return SafetyTask(client, made, wanted, tools, feeds, prove, is_proven=is_proven, spare=spare)
