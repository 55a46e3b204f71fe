"""What campaigns await of the program's sentences, as far as it is the same each time.

Campaigns run rarely, and a sentence that is worded anew would be missed there for long: here stands
each once, and `test_awaited.py` holds that the program writes it.
"""

from __future__ import annotations

import re

from support.product import SILENT_S, TIMED_READS

SEALING_CHILD_ENDED = "the sealing child ended with"
CAPTURE_LACKS = "The serial capture is not whole:"
RECORDING_ENDS = "the capture ends"
LEFT_HOT_NOTED = "left tools hot; noted in its record"
HAS_A_GUARD = "has a guard already"
MADE_SAFE_BY_GUARD = "was put in its safe state by the guard"
NOT_CONFIRMED_TO_GUARD = "was ordered into its safe state by the guard and does not confirm it"
LINK_FLOODED = "the link is flooded"
ITS_LINK_FLOODED = "(its link is flooded)"
CLOCK_STEPPED = "The host's clock was stepped by"
NOT_STARTED = "the run did not start because of"
ON_THE_BENCH = "was on the bench when the run ended"
INTERNAL_ERROR = "internal error"

HOW_OFTEN = re.compile(
    rf"in \d+ (?:try|tries|writes?)\b|only \d+ of {TIMED_READS} questions"
    rf"|silent for {SILENT_S:g} s in step \d"
)
"""Of a start that was refused: at which setting or reading, after how many tries."""
