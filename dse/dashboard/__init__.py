"""The page of a study: one HTML file that holds its data and its code, and opens without a server.

`gather` computes every number of the page, fronts included, on the full table; `write` fills the template
of `dashboards/`, whose script only shows what it is given. A figure is added in `dashboards/page.js`.
"""

from dse.dashboard.gather import gather_page
from dse.dashboard.write import write_page

__all__ = ["gather_page", "write_page"]
