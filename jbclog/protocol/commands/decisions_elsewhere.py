"""Contradictions that concern hot air and OMEGA only, each with its decision."""

from __future__ import annotations

from jbclog.protocol.commands.decision import Decision

HOT_AIR = ("jtse",)
OMEGA = ("omega",)

HOT_AIR_ROWS = (
    Decision(
        33,
        "The unit of the air flow is not printed",
        "the share of the station's own R-MAF in per mille; the raw numbers of R-SF, R-MIF and R-MAF stand in `settings`",
        "No manual decides; a share needs no unit, and the raw numbers can be read anew once somebody knows.",
        met="No manual gives the air flow a unit; its numbers are kept as they came, and sampled as shares of the greatest.",
        doubtful=True,
        usual=True,
        families=HOT_AIR,
    ),
    Decision(
        41,
        "R-OH: on hours, plugged hours or connected hours",
        "`on_h`: hours with the mains on",
        "One command, one number; only its name is in doubt.",
        families=HOT_AIR,
    ),
    Decision(
        42,
        "Work mode: only JTSE has it; its value while a profile runs is not printed",
        "00000 manual, 00001 profile, as printed",
        "Nothing contradicts the two printed numbers.",
        families=HOT_AIR,
    ),
    Decision(
        43,
        "W-PS: no answer is printed for hot air",
        "APS1, and APS1 with the very value that was written",
        "Either can only acknowledge, and the status is read back.",
        ("status_acknowledged_with_value",),
        "The acknowledgement of a status repeats its value.",
        families=HOT_AIR,
    ),
    Decision(
        44,
        "External temperature without a thermocouple is not printed",
        "null while the port reports a missing thermocouple (error 4)",
        "Any number may stand there, and none means anything.",
        families=HOT_AIR,
    ),
    Decision(
        45,
        "Station error 7 is missing for JTSE, 1 and 2 are not used",
        "the common table",
        "A number that never arrives does no harm.",
        families=HOT_AIR,
    ),
)

OMEGA_ROWS = (
    Decision(
        46,
        '"Stop bit length 8 bit" and no line for data bits',
        "9600, 8 data bits, 1 stop bit",
        "Two rows of the table were swapped; no serial port has 8 stop bits.",
        families=OMEGA,
    ),
    Decision(
        47,
        'A response time of "0250ms"',
        "0 to 250 ms; an answer is waited for longer than that",
        "Another print of the page has 0~250ms. A virtual station has `turnaround_ms`.",
        families=OMEGA,
    ),
    Decision(
        48,
        "A is printed as 41H('')",
        "A",
        "41h is the letter A, and it is the only letter that a is an answer to.",
        families=OMEGA,
    ),
    Decision(
        49,
        '"Two bytes", "4 digits (2 byte)" and "4 byte" for the same field',
        "ASCII characters, as the ruler of positions counts them",
        "The ruler of C has nine bytes, and only characters give nine.",
        families=OMEGA,
    ),
    Decision(
        50,
        "c and D have one title; d is called a reply from the external controller",
        "a capital letter is the host's, a small one the controller's",
        "So it is in every other pair; the other reading would answer before it is asked.",
        families=OMEGA,
    ),
    Decision(
        51,
        "A set temperature in tenths would end at 409.5 °C",
        "tenths, as for every field; the three digits are kept as they came, and marked",
        "No text decides; only a known temperature, read back, can.",
        ("temperature_in_degrees",),
        "A condition sets a temperature, and no document says whether its number is in tenths; it is kept as it came.",
        doubtful=True,
        usual=True,
        families=OMEGA,
    ),
    Decision(
        52,
        "E is missing, K is an example only, later pages were not found",
        "A, B, C, F and G are asked; D and H only where they are allowed by name",
        "What is not described is not sent.",
        families=OMEGA,
    ),
)
