"""``report.html``: one self-contained page, made from the other files of the folder."""

from farpoint.sinks.report.write import REPORT_NAME, write_report

__all__ = ["REPORT_NAME", "write_report"]
