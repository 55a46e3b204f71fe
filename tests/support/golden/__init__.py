"""What the manuals print, byte by byte: the referee between the client, the simulator and the
tables.

Typed from the manuals by hand. Nothing here imports anything of the product, so that nothing here
can agree with it by descent; a test holds that. Three kinds:

- `Golden`: a whole frame. Printed is mostly its text only ("A-ST1- 00350"): it stands here without
  the hyphens and blanks of typography, between STX and ETX, with its check byte behind. These are
  the frames without addresses; `addressed` puts the addresses in.
- `Field`: a control field that is printed as an example while its data is left out ("for example
  WST3").
- `Listed`: a row of a printed list, as the data field that it stands for ("00004 No tool").

`where` is the manual's number and its section, or its row where it has no sections; `page` the page
on which the example stands, counted as the manual's module says; `printed` quotes it (`` ... ``
stands for words between).

The manuals were searched for: every control code between quotation marks, with a port (and tool) or
without, bare or with data behind it; every code in the heading of its section or row; every number
of five characters, hexadecimal numbers too, that is given as data, as a bound of data or as a row
of a list; every line of bytes. Left out are: codes with an x or y for the port and tool, and the
lists of codes (`letters` has both); ports and rates of the line, which are not data; a word that
stands a second time in the same section; upper bounds of what a field of five characters holds
(99999).
"""

from support.golden import letters, manual_000, manual_001, manual_002, manual_003, manual_004
from support.golden.form import OFF, Field, Golden, Listed, framed, summed, wire_of, with_check_byte

JBC = (manual_000, manual_001, manual_002, manual_004)
FRAMES = [golden for manual in JBC for golden in manual.FRAMES]
FIELDS = [field for manual in JBC for field in manual.FIELDS]
LISTED = [listed for manual in JBC for listed in manual.LISTED]
WHOLE = [*manual_002.WHOLE, *manual_004.WHOLE]

__all__ = [
    "FIELDS",
    "FRAMES",
    "JBC",
    "LISTED",
    "OFF",
    "WHOLE",
    "Field",
    "Golden",
    "Listed",
    "framed",
    "letters",
    "manual_003",
    "manual_004",
    "summed",
    "wire_of",
    "with_check_byte",
]
