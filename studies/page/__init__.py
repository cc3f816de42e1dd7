"""The report of a run: one page, `report.html`, that needs nothing else.

In reading order: `write` (what is in it), `report.html` (the template), `sentences` (the answer in words),
`vector` (figures within the page), `citation`.
"""

from studies.page.write import Report, write_page, write_report

__all__ = ["Report", "write_page", "write_report"]
