"""Encoders: sampled signals in, spikes out.

A component of section `encoders` is a frozen dataclass with `n_channels(n_in) -> int` and
`encode_all(signals, first, length) -> Spikes`. To add one, add one file here that registers such a class.
"""
