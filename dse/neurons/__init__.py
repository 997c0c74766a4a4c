"""Neuron equations, written once and readable: the definition that every fast path is tested against.

Contract: `step` takes a state and returns a new one; nothing is hidden and nothing is mutated.
To add a neuron, add a file with `Params`, `State`, `initial_state` and `step`.
"""
