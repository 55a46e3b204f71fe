"""The page of an audit: one HTML file that needs nothing but itself, made by a template from the value of a fleet.

Everything that comes from outside is cleaned and escaped by the template engine; the drawings are of numbers only; a content policy
forbids every request and every script. The same audit gives the same bytes.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from jbclog import __version__
from jbclog.core.text import clean, number, stamp, together
from jbclog.maintenance.fleet import TITLES, FleetAudit
from jbclog.report.audit import plots, wording
from jbclog.report.audit.overview import at_a_glance
from jbclog.report.audit.table_rows import (
    MOST_MARKS,
    Notes,
    courses,
    drift_rows,
    error_rows,
    fleet_weeks,
    marks,
    meters,
    turns,
    unread,
    use_rows,
)

COUNTS_MOST: Final = 10  # stations up to which their counters stand open on the page


def page_of(audit: FleetAudit) -> str:
    """The page of an audit, as HTML; its bytes follow from `audit` alone."""
    notes = Notes()
    rows = use_rows(audit, notes)
    weeks = fleet_weeks(audit)
    return (
        _environment()
        .get_template("audit.html")
        .render(
            audit=audit,
            glance=at_a_glance(audit),
            uses=rows,
            most=plots.scale_of(week for row in rows for week in row.station.weeks),
            notes=notes,
            weeks=weeks,
            drawn=len(courses(audit)),
            drifts=drift_rows(audit),
            marks=marks(audit),
            most_marks=MOST_MARKS,
            meters=list(meters(audit)),
            turns=turns(audit),
            unread=list(unread(audit)),
            is_open=len(audit.stations) <= COUNTS_MOST,
            errors=list(error_rows(audit)),
            titles=TITLES,
            months=plots.months(audit.audit),
            bar=plots.bar,
            due=partial(plots.due, now=audit.audit),
            spent=plots.spent,
            course=plots.course,
            fleet_course=plots.fleet_course,
            SPENT=plots.SPENT,
            version=__version__,
        )
    )


def _shown(value: object) -> object:
    """What a template writes: text from outside without anything that steers."""
    return clean(value) if isinstance(value, str) and not isinstance(value, Markup) else value


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("jbclog.report.audit"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_shown,
    )
    environment.filters.update(number=number, stamp=stamp, together=together, span=wording.span, percent=wording.percent)
    environment.filters.update(day=wording.day, of_life=wording.of_life, window=wording.window)
    environment.globals.update(place=wording.place, counted=wording.counted, COUNTERS=wording.COUNTERS, STATES=wording.STATES)
    return environment
