"""What a receiver makes of characters that were sent at another rate or parity than its own: bit by bit, as on a wire.

A receiver waits for a falling edge and looks at the line in the middle of each bit that should follow, by its own clock.
Of the stop bits it looks at the first only, so that one or two make no difference to it.
"""

from __future__ import annotations

from collections.abc import Iterator

from jbclog.core.line_format import LineFormat

IDLE = 1
DATA_BITS = 8


def heard(data: bytes, sender: LineFormat, receiver: LineFormat, *, keeps_errors: bool = False) -> bytes:
    """What `receiver` hears of `data`, sent without a pause by `sender`.

    Characters whose parity or stop bit is wrong are dropped, as a careful station does, or kept, as Linux does with the
    settings that serial programs use.
    """
    if (sender.baudrate, sender.parity) == (receiver.baudrate, receiver.parity):
        return data
    levels = [level for byte in data for level in _character(byte, sender)]
    return bytes(byte for byte, is_good in _received(levels, sender.baudrate, receiver) if is_good or keeps_errors)


def _character(byte: int, line: LineFormat) -> list[int]:
    """The levels of one character, bit after bit: start, data from the lowest bit up, parity, stop."""
    data = [byte >> place & 1 for place in range(DATA_BITS)]
    return [0, *data, *_parity(sum(data), line), *[IDLE] * line.stop_bits]


def _parity(ones: int, line: LineFormat) -> list[int]:
    return [] if line.parity == "N" else [(ones + (line.parity == "O")) & 1]


def _received(levels: list[int], baudrate: int, receiver: LineFormat) -> Iterator[tuple[int, bool]]:
    """Each character that the receiver finds in the levels, and whether its parity and stop bit hold."""

    def level_at(seconds: float) -> int:
        place = int(seconds * baudrate)
        return levels[place] if place < len(levels) else IDLE

    parities = receiver.parity != "N"
    edge = _falling_edge(levels, 0)
    while edge is not None:
        starts = edge / baudrate
        looked = [starts + (bit + 0.5) / receiver.baudrate for bit in range(1 + DATA_BITS + parities + 1)]
        start, *bits = [level_at(moment) for moment in looked]
        data, parity, stop = bits[:DATA_BITS], bits[DATA_BITS:-1], bits[-1]
        if start == 0:  # else a spike that was over too soon
            yield sum(bit << place for place, bit in enumerate(data)), stop == IDLE and parity == _parity(sum(data), receiver)
        done = looked[-1] if start == 0 else looked[0]
        edge = _falling_edge(levels, max(int(done * baudrate), edge + 1))


def _falling_edge(levels: list[int], first: int) -> int | None:
    """The first place from `first` on at which the line goes from idle to 0."""
    before = levels[first - 1] if 0 < first <= len(levels) else IDLE
    for place in range(first, len(levels)):
        if before and not levels[place]:
            return place
        before = levels[place]
    return None
