"""Model families: a frozen dataclass of settings with `fit`, and functions that respond and count.

Contract: `fit(dataset, training, rngs)` returns an `Outcome`; `rngs(purpose, *index)` gives the
random generator of a purpose, so that a design's result depends on nothing but the design.
To add a family, add a file with a dataclass registered in section "models".
"""
