"""Proposing designs: the space as a grid (`space`) and the samplers (`samplers/`).

A sampler is a frozen dataclass of settings with `start(space, directions) -> Sampler`. It inherits from
`dse.config.contracts.SamplerSettings`. The started sampler has `ask(n) -> designs` and
`tell(designs, values)`. With the same history it proposes the same designs, so a study that was stopped
continues as if it had never stopped. A sampler that cannot search axes which only some designs have (those of
one component of a choice) declares `conditional: ClassVar[bool] = False`. A sampler that needs a package of
an extra names the package: `requires: ClassVar[str] = "torch"`. To add one, add one file to `samplers/`.
"""
