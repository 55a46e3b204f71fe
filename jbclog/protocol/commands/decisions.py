"""Contradictions, misprints and gaps of the manuals, each with jbclog's interpretation.

Each row states the contradiction, jbclog's choice, and the reason; then how a virtual station
behaves in the alternative, and the text of the event when a station does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Decision:
    """A row of docs/reference/contradictions.md.

    `reading`: what is sent and how answers are interpreted. `quirks`: alternatives of virtual
    stations, all of them accepted. `met`: text of the first event ``protocol.anomaly`` (code:
    `number`); empty if a run cannot meet it. `doubtful`: the value may be wrong. `usual`: normal
    for its kind of station, so no warning. `families`: empty for all with JBC's protocol.
    """

    number: int
    title: str
    reading: str
    reason: str
    quirks: tuple[str, ...] = ()
    met: str = ""
    doubtful: bool = False
    usual: bool = False
    families: tuple[str, ...] = ()


HOT_AIR = ("jtse",)
OMEGA = ("omega",)

HOT_AIR_ROWS = (
    Decision(
        33,
        "The unit of the air flow is not printed",
        "the share of the station's own R-MAF in per mille; the raw numbers of R-SF, R-MIF and"
        " R-MAF stand in `settings`",
        "No manual decides; over USB, real stations send per mille of the maximum. A share needs no"
        " unit, and the raw numbers can be read anew once somebody knows.",
        met=(
            "No manual gives the air flow a unit; its numbers are kept as they came, and sampled as"
            " shares of the greatest."
        ),
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
        "003 11.3.6 has both: a decimal point is left out (a temperature has none), and the value"
        " is a tenth of the number. Only a known temperature, read back, can decide.",
        ("temperature_in_degrees",),
        "A condition sets a temperature, and the manual has two rules for its scale; its number is"
        " kept as it came.",
        doubtful=True,
        usual=True,
        families=OMEGA,
    ),
    Decision(
        52,
        "E is missing, K is an example only, page 11 and later ones were not found",
        "A, B, C, F and G are asked; D and H only where they are allowed by name",
        "What is not described is not sent.",
        families=OMEGA,
    ),
    Decision(
        55,
        "F has two meanings, by a setting of the controller that cannot be read",
        '`in_range` is true at 0: with "Range" or "No check" the temperature is between the alarm'
        ' limits, with "Setting value" it is judged optimal',
        "003 11.3.10 prints both meanings, and no command reads the setting. The digit is kept as"
        " it came.",
        ("in_range_is_optimal",),
        "F says whether the temperature is within the alarm limits or whether it is optimal, by a"
        " setting of the controller that cannot be read; the column in_range has its digit.",
        doubtful=True,
        usual=True,
        families=OMEGA,
    ),
)


LINK = (
    Decision(
        1,
        "Baud rates 1200 to 500000 with any parity, or 19200 8N1 only",
        "as the line file states; 19200 8N1 without it",
        "An old station's menu decides, and a wrong format gives garbage and no answer: `scan`"
        " tries them in turn.",
    ),
    Decision(
        2,
        "Pins 3 and 4: Tx and Rx, or the station's RX and TX",
        "the same wiring, named from either side",
        "No byte shows the names of pins; `doctor` suggests a swapped pair where nothing answers.",
    ),
    Decision(
        3,
        "The minus is printed as a dot (000) and as a hyphen (001, 002, 004)",
        "a hyphen is written; a dot in the first place of an adjustment is read as a minus",
        "The dot of ss.cc is in the third place, so nothing else can be meant.",
        ("minus_as_dot",),
        "A negative number has a dot in the place of its minus; it is read as negative.",
    ),
    Decision(
        4,
        "Numbers from -9999 to 99999, or none below -0050",
        "the whole range is read; no adjustment below -50 is written, and above 50 none where 002"
        " prints that bound",
        "-0050 is the lowest adjustment, not the lowest number; both readings take every number"
        " that a station can send.",
    ),
    Decision(
        5,
        "Data of 0 or 5 characters, and longer examples",
        "a frame ends with ETX, whatever its length; what each command should carry is in its row",
        "Length, model and software have no five characters in the manuals' own examples.",
        ("software_in_ten_characters",),
        "The software version is not five characters wide; blanks around it are left out.",
    ),
    Decision(
        6,
        "The order of the addresses in an answer is not stated",
        "the station first, the robot second; the other order is taken too and learnt",
        'The field is defined as "the sender\'s"; the check byte is the same in both orders, so it'
        " proves neither.",
        ("addresses_swapped",),
        "Answers name the robot before the station; either order is taken.",
    ),
    Decision(
        7,
        "Frames with addresses by menu, or by default",
        "as the line file states; with addresses without it",
        "A virtual station takes it from the same key; `scan` tries both, and a digit behind STX"
        " means addresses.",
    ),
    Decision(
        8,
        "Feeder 10 and extractor 20 have addresses and no commands",
        "an ALE is a soldering station at 01, unless the line file states 10",
        "The examples for ALE use 01; `scan` falls back to 10, and the line file's address is what"
        " a run uses.",
    ),
    Decision(
        9,
        "W-SAD 00000: address 00 or no addresses; its acknowledgement is not printed",
        "sent by `write` only; then R-SMN must be answered at the new address, else at the old one",
        "The acknowledgement may come from the old address, the new one, or without any; what"
        " counts is who answers.",
        ("address_acknowledged_from_the_new_one", "address_acknowledged_without_any"),
        "The change of address is not acknowledged from the old address; who answers at the new one"
        " is asked.",
    ),
    Decision(
        10,
        "R-TT has two letters in a field of three; padding is not printed",
        "sent bare; one try with a blank where it is refused or not answered, then counted as not"
        " supported",
        "ATT and six characters is the transformer only where the first is a blank or 0: no port"
        " has that number.",
        (
            "transformer_padded_with_blank",
            "transformer_padded_with_zero",
            "transformer_wants_blank",
        ),
        "The transformer's temperature is asked or told with a third character behind TT; it is"
        " left out.",
    ),
    Decision(
        11,
        "What an N frame repeats is not printed",
        "with the question's code, without any, or, for N 1 and 2, with another: it refuses the one"
        " question that is out",
        "One question is out at a time; after a wrong check byte the station cannot know the code.",
        ("refusal_without_code",),
        "A refusal does not repeat what it refuses; it is taken for the question that was out.",
    ),
    Decision(
        12,
        "The acknowledgement of a write carries no value",
        "every setting is read back; only then it is `confirmed`",
        "All manuals agree on the frame; what it proves is the question, and reading back answers"
        " that.",
    ),
    Decision(
        13,
        "No response time, no rule for repeats",
        "300 ms at first, then four times the slowest answer seen, 100 ms to 2 s; reads three"
        " times, writes once",
        "Nothing to be accepted or not; a virtual station has `turnaround_ms`, and its late answers"
        " are a fault of their own.",
    ),
    Decision(
        14,
        "A frame for another address or without one: silence or N 2",
        "silence and N 2 alike mean that no station has this address",
        "It matters only to who seeks a station (`scan`, `doctor`, and after W-SAD), and who seeks"
        " counts neither as an answer.",
        ("refuses_other_addresses",),
    ),
    Decision(
        15,
        "Hyphens, spaces and an À in the printed examples",
        "typography; never sent",
        "A code is made of the table's letters and digits, and a frame of printable ASCII.",
    ),
    Decision(
        16,
        "Ports and baud rates printed as 01h to 04h and 00h to 0Bh",
        "a port is an ASCII digit",
        "The hexadecimal numbers are the station's own; every printed frame has a digit.",
    ),
)

STATUS = (
    Decision(
        17,
        'Units 0 of the status: "no stand" or "working"',
        "`working`",
        "One digit, two names for it.",
    ),
    Decision(
        18,
        'Tens of the status: "extractor" or "cooling"',
        "one flag in the column `cooling`",
        "One digit; its name is the family's. Over USB, too, real hot air stations report heater"
        " and cooling apart.",
    ),
    Decision(
        19,
        "Status words that may be written: 0 and 1, or 10 as well",
        "00000, 00001, and 00010 on every family of 002; where 00010 is refused as the safe state,"
        " 00001 follows",
        "002 prints 00010 for W-PSx without a limit of family, 000 prints 00000 and 00001 only."
        " Asked for by a recipe at the start, a refusal stops the station as that of any setting"
        " does.",
        ("extractor_refused",),
        "The extractor state 00010 is refused; where it was to be the safe state,"
        " the tool is ordered to stand.",
        families=("dde", "nae", "dme", "hde", "ucr", "ale"),
    ),
    Decision(
        20,
        "Sleep and hibernation delays: no unit, minutes, and defaults in seconds",
        "minutes, as 002 and 004 say; the number stands in `settings` as it came, and defaults are"
        " never assumed",
        "Nothing proves the unit but the station: right after the order to stand, R-ED is held"
        " against the delay. Over USB real stations count these delays in minutes.",
        ("sleep_delay_in_seconds",),
        "Right after the order to stand, the time to sleep does not agree with a delay in minutes;"
        " both are kept as they came.",
        doubtful=True,
    ),
    Decision(
        21,
        "99999 disables the sleep mode, or the hibernation mode, under other commands",
        "it disables the very thing that the command sets, and is written for delays only",
        "A slip of the text under W-H, W-HD and W-LD; on the wire all four are 99999.",
    ),
    Decision(
        22,
        "Alarm delays as ss.cc in a field of digits; the least is 00.00 or 00.10",
        "ss.cc, 00.00 at once; five digits without a dot are hundredths; 00.00 that is refused"
        " stops the start",
        "99999 is off in either form, and 160 hundredths can be nothing else. A comma or a dot"
        " elsewhere is no delay.",
        ("delay_without_dot",),
        "An alarm delay has no dot; its digits are read as hundredths of a second.",
    ),
    Decision(
        23,
        'An alarm limit that is "not set" has no printed number',
        "99999, 00000 and what no station can reach (above 600 °C) are not set; none of them is"
        " ever written",
        "99999 is what the manuals print for everything else that is off.",
        ("alarm_not_set_is_zero", "alarm_not_set_is_out_of_range"),
        "An alarm limit that cannot be one is read as not set.",
    ),
    Decision(
        24,
        "Reading the alarm flags clears them (000), or nothing is printed about it; 1 is set",
        "read by one reader, once for each answer; any digit but 0 is set",
        "Flags that stay set are reported once, as flags that are raised again are. Over USB, real"
        " stations clear a set alarm temperature when it is read.",
        ("alarm_flags_of_any_digit", "alarm_flags_stay"),
        "An alarm flag is neither 0 nor 1; it is taken as set.",
    ),
    Decision(
        25,
        "The time to sleep when nothing counts down is not printed",
        "99999, 65535, and 0 while the tool is not waiting are no time: null, `not_counting`",
        "65535 is the value of the maker's other protocol, seen on real stations over USB.",
        ("countdown_65535", "countdown_zero"),
        "Without a countdown the time to sleep is a number; it is read as none.",
    ),
    Decision(
        26,
        "A factory table gives an offset of 0 °C as 32 °F",
        "an offset of 0 K; all temperatures are °C",
        "Fahrenheit is never on the wire.",
    ),
    Decision(
        27,
        "The selected temperature is volatile, or nothing is printed about it",
        "volatile; a run never sends W-NVS, and after a restart of the station its settings are"
        " read again",
        "A station that kept it would answer the same; the EEPROM wears.",
    ),
)

VALUES = (
    Decision(
        28,
        "Port error 80000 or 00008",
        "80000 is read as 8",
        "A misprint: the other two manuals have 00008, and no table has 80000.",
        ("port_error_80000",),
        "A port error is 80000; it is read as 8.",
    ),
    Decision(
        29,
        "One tool number, several tools",
        "the number is kept; its name is the family's table, and an unknown one is tool_<n>",
        "The number on the wire is the same whatever it is called. For 2 and 9 the sources"
        " disagree: 000 has T245/T470 for 2 and no 9, 002 has TRA245/TRA470 for 9, and real"
        " stations over USB say T245 for 2 and T470 for 9.",
    ),
    Decision(
        30,
        "Port errors 4 and 9 mean other things on hot air",
        "the table is the family's, and the family is proven by R-SMN before any is read",
        "The number alone does not show it; the model does.",
    ),
    Decision(
        31,
        "Highest temperature 500 °C, or 450 for UCR245",
        "R-MAT and R-MIT are read before the first write, and the recipe is held to them",
        "The station reports its own limits, so neither print is needed.",
    ),
    Decision(
        32,
        "Power in per cent in the text, in per mille in the examples",
        "per mille; more than 1000 is kept",
        "00840 is printed as 84 %. Over USB, real stations send per mille and clamp at 1000.",
        ("power_above_full",),
        "The power is above 1000 per mille; it is kept as it came.",
        doubtful=True,
    ),
    Decision(
        34,
        "Model names of five characters, and models of six letters",
        "blanks on either side are left out, any length is accepted, and its beginning gives the"
        " family",
        "UCR245 does not fit in five characters, so either the field is longer or the name is cut."
        " Over USB, a real station's name has its type and a number behind it: JTSE_CAP_01.",
        ("six_letter_model", "model_cut_to_five", "model_unpadded", "model_with_type"),
        "The model name is not what fills five characters;"
        " its beginning is enough to tell the family.",
    ),
    Decision(
        35,
        "Dispensed length: hexadecimal with 0x and eleven digits in a field of five",
        "hexadecimal of any width, with or without 0x, in either case; the column `raw` keeps the"
        " characters",
        "Digits without a letter are hexadecimal too. Only a known length can prove it, so such"
        " numbers are marked.",
        ("hex_with_0x", "hex_lower_case", "hex_of_eight"),
        "A dispensed length is not five capital hexadecimal digits, or has no letter that proves it"
        " hexadecimal; it is read as hexadecimal, and its characters are kept.",
        doubtful=True,
        usual=True,
    ),
    Decision(
        36,
        "R-DCx is answered by ACDx, which is the answer to R-CDx",
        "ADCx; ACDx only from a station that never used ADCx, and only when two answers agree"
        " (`protocol/client/robot.py`)",
        "The text of R-DCx is a copy of R-CDx; a late or repeated ACDx must not become a count of"
        " dispensed cycles.",
        ("dispensed_cycles_answers_acd",),
        "R-DC is answered by ACD; it was asked twice over a drained line, and said the same.",
        doubtful=True,
    ),
    Decision(
        37,
        "Orders without printed data: STR, STP, RST, RSP, IFE",
        "00000; where N 2 refuses that, STP and IFE once without data",
        "STR, RST and RSP act or erase: they are sent once, whatever the answer.",
        ("no_data_orders",),
        "An order with data 00000 was refused as badly formed; it was sent again without data.",
    ),
    Decision(
        38,
        'W-SPD modifies the "length", W-LEN has no text, W-SE the "air flow"',
        "what the code's letters say",
        "Slips of the text; the codes are distinct.",
    ),
    Decision(
        39,
        "The rows of R-FST, R-LEN, R-CPx and R-PEx are garbled",
        "fuse status, UCR only; elsewhere N 4 means not supported",
        "Codes and data can be read; what is lost are words of the description.",
    ),
    Decision(
        40,
        "W-RST: restart, station reset, or reset of settings; its answer is printed nowhere",
        "a restart; acknowledged or not, the station is asked until it answers steadily again",
        "Dangerous, and never sent by a run.",
        ("silent_after_restart",),
        "The order to restart was not acknowledged; the station was asked until it answered again.",
    ),
)

UNDEFINED_NUMBER = Decision(
    54,
    "The undefined communication error is N 99999, or 255 in the maker's other protocol",
    "N 00255 is an undefined error as N 99999 is: a read is sent once more",
    "255 is seen on real stations over USB only; no manual gives the number another meaning.",
    ("undefined_error_255",),
    "A refusal has the number 255; it is taken as the undefined error.",
)

PLAIN_MISPRINTS = Decision(
    53,
    "B.4, misprints without effect on the wire; W-HDx answered by ALDx (000, 4.8.24) is the one"
    " that could have one",
    "AHDx; ALDx for a pending W-HDx on the same port, when no answer to W-LDx can be under way",
    "The example there is AHD3. An acknowledgement proves nothing either way: the delay is read"
    " back.",
    ("alarm_delay_answers_ald",),
    "The upper alarm delay is acknowledged as the lower one; it was read back.",
)


def _number(row: Decision) -> int:
    return row.number


DECISIONS: Mapping[int, Decision] = MappingProxyType(
    {
        row.number: row
        for row in sorted(
            (
                *LINK,
                *STATUS,
                *VALUES,
                *HOT_AIR_ROWS,
                *OMEGA_ROWS,
                PLAIN_MISPRINTS,
                UNDEFINED_NUMBER,
            ),
            key=_number,
        )
    }
)
