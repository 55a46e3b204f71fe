"""Why a difference is what it is said to be: a sentence for each rule."""

from __future__ import annotations

from typing import Final

RULES: Final = {
    "unchanged": "It shows what it showed.",
    "went_on": "It went on, and not faster than can be.",
    "fell_from_near_its_top": "It alone fell, and went on from zero after its last number: at the pace that it had, it was once.",
    "fits_its_companion": "Only this many roll-overs fit what was fed meanwhile, at the length a feed that was seen before.",
    "rolled_over_unknown_times": "It rolled over, and at its pace it can have done so more than once since the last reading.",
    "can_have_rolled_over": "At its pace it can have rolled over since the last reading without showing it.",
    "stands_at_top": "It shows its last number: no manual says whether it stands still there or goes on from zero.",
    "fell_alone": "It alone fell, from where it cannot have rolled over, and others show that the station was not reset.",
    "fell_to_what_cannot_be": "It fell to more than can have been counted since the last reading: neither a reset nor a roll-over.",
    "faster_than_time": "It counted more hours than there were between the readings.",
    "beside_what_cannot_be": "It fits, but other counters of the station do not: these may be another station's.",
    "faster_than_plausible": "It counted faster than is plausible.",
    "clock_ran_back": "The host's clock was set back; until a later reading nobody knows how long it was in between.",
    "fell_since": "It fell to what can have been counted since the last reading; what it counted before the reset is lost.",
    "reset_or_other_unit": "It was reset, or exchanged for a unit that was hardly used: only the time bounds what was worked.",
    "reset_with_its_port": "Others of its port were reset, and it shows no more than can have been counted since.",
    "stated_reset": "It was reset, as somebody told; what it counted between the last reading and then is lost.",
    "can_hide_reset": "All that is shown can have been counted since the last reading, so that a reset in between would not show.",
    "rolled_over_or_reset": "It fell: it rolled over or was reset, and no other counter tells which.",
    "left_out": "It fits neither the reading before it nor the one after, and these fit each other: it is left out.",
    "other_model": "The station's model is another.",
    "other_uid": "The station's number is another.",
    "other_software": "The software is another, and the counters do not go on from those before.",
    "stated_replaced": "The station was replaced, as somebody told.",
    "counters_of_another": "Several counters fell to more than can have been counted since the last reading: another station's.",
}
