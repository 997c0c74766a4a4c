"""Pages of a study and of a trial: one HTML file each, with its data and code; it opens offline.

`serve` shows a study's page while the study runs.

`gather` computes every number of a study's page, fronts included, on the full table; `write` fills a template
of `dashboards/`, whose scripts only show what they are given. `details` gathers what is shown of one design
beyond its points, `progress` how the study goes; `definition` reads which parts a page has. Figures of a
design come from `dse.figures`; a view over all points is a module of `dashboards/`.
`trial` writes two figures of `dse.figures`, and what its script needs to move the first one through time.
"""
