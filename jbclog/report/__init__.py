"""REPORT. One run as a page that opens offline, and the same facts as JSON.

Owns: what the report says and in which order; the figures; the page. `write_report` is the whole of it.
Never: changes the record, asks a station, loads a plotting library (it took nine tenths of a report's time), or lets text
from outside become markup. The same run gives the same bytes.
May use: `analysis`, `judge`, `judged_again`, `spc`, `record`, `recipe`, `commands`, `rows`, `cells`, `shown`, `errors` and
`foreign`; jinja2, fpdf2, fontTools and matplotlib's font files.
Start reading: `write.py`, then `facts.py`; `trace.py` and `figure.py` draw; `svg.py` and `pdf_file.py` write drawings down.
"""

from jbclog.report.write import verified, verify_report, write_report

__all__ = ["verified", "verify_report", "write_report"]
