"""Encoders: sampled signals in, spikes out.

A component of section `encoders` is a frozen dataclass that inherits from `dse.config.contracts.Encoder`,
which says what it must do; to add one, add one file here that registers it.
"""
