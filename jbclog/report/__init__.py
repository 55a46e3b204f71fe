"""REPORT. One run as a page that opens offline, and the same facts as JSON.

Owns: what the report says and in which order; the figures; the page. `write_report` is the whole of it.
Never: changes the record, asks a station, uses pyplot (its state is global), or lets text from outside
become markup. The same run gives the same bytes.
May use: `analysis`, `judge`, `joint_evidence`, `record`, `recipe`, `commands`, `rows`, `cells`, `shown`, `errors`; matplotlib and jinja2.
Start reading: `write.py`, then `facts.py`; `trace.py` and `figure.py` draw.
"""

from jbclog.report.write import verify_report, write_report

__all__ = ["verify_report", "write_report"]
