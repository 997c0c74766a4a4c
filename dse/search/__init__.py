"""Proposing designs: the space as a grid (`space`) and the samplers (`samplers/`).

A sampler is a frozen dataclass of settings with `start(space, directions) -> Sampler`; the started sampler
has `ask(n) -> designs` and `tell(designs, values)`. Given the same history it asks for the same designs, so
a study that was stopped goes on as if it had not been. A sampler that cannot search axes which only some
designs have (those of one component of a choice) says so: `conditional: ClassVar[bool] = False`. One that
needs a package of an extra names it: `requires: ClassVar[str] = "torch"`. To add one, add one file to
`samplers/`.
"""
