"""One file per published system: `rows(parts)` returns its numbers for one task on the same recordings.

`marks(parts)` returns those of its designs whose published numbers are in these rows (`dse.report.marks`).
`printed()` is optional and returns published numbers that have no measurement of ours.
"""
