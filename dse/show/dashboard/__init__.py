"""Pages of a study and of a trial: one HTML file each, with its data and code; it opens offline.

`serve` shows a study's page while the study runs.

`gather` computes every number of a study's page, fronts included, on the full table; `write` fills a template
of `dashboards/`, whose scripts only show data. `details` gathers the details of one design, `progress` the
progress of the study; `definition` reads the parts and the initial settings of a page. Figures of a design
come from `dse.show.figures`; a view over all points is a module of `dashboards/`. `trial` writes two figures
of `dse.show.figures`, and the data with which its script moves the first one through time.
"""
