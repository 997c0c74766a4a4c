"""One file per published system: `rows(parts)` returns its figures for one task on the same recordings.

`printed()`, where there is one, returns printed figures that we measure nothing beside.
"""
