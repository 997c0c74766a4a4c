"""One file per published system: `rows(parts)` returns its figures for one task on the same recordings.

`marks(parts)` returns those of its designs whose printed figures are among these rows (`dse.report.marks`).
`printed()`, where there is one, returns printed figures that we measure nothing beside.
"""
