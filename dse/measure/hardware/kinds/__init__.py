"""Kinds of hardware: what numbers a profile holds, and what an inference costs by them.

One file each: a frozen dataclass of `figure`s, `@register("hardware.kinds", name)`, with a method `plan`.
"""
