"""The prefix of a classifier's names in C: with prefixes of their own, several live in one program."""

from __future__ import annotations

import re

DEFAULT = "dse_"
_PREFIX = re.compile(r"[a-z][a-z0-9_]{0,39}_")
_TAKEN = frozenset(
    "arduino assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdarg "
    "stdbool stddef stdint stdio stdlib string tgmath time wchar wctype "
    "all app clean help install package selftest test touch zephyr "
    "board sensor_adc sensor_i2c sensor_spi spi wire".split()
)
"""Headers that a file of the same name would hide, the sketch's too; targets of CMake, of Zephyr."""


def checked(prefix: str) -> str:
    """Return a prefix after checking that it can begin names in C and name a header."""
    if not _PREFIX.fullmatch(prefix):
        allowed = "a-z, 0-9 and _, begin with a letter, end with _, and have at most 41 characters"
        raise ValueError(f"the prefix must be of {allowed}, got {prefix!r}")
    if prefix[:-1] in _TAKEN:
        raise ValueError(
            f"the prefix must not be that of a header of C or of a target of CMake, got {prefix!r}"
        )
    return prefix


def prefixed(text: str, prefix: str) -> str:
    """Return text, such as C or an option of a compiler, in which names begin with a prefix.

    dse_init becomes texture_init, DSE_STEP_MS becomes TEXTURE_STEP_MS, and dse.h becomes texture.h.
    """
    if prefix == DEFAULT:
        return text
    text = re.sub(r"\bdse_", prefix, text)
    text = re.sub(r"\b(D?)DSE_", rf"\g<1>{prefix.upper()}", text)
    return re.sub(r"\bdse(\.[ch])\b", rf"{prefix[:-1]}\1", text)
