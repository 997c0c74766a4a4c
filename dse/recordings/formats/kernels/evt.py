"""The state machines of Prophesee EVT 2.0 and 3.0: words that hold an event, or what later ones leave out."""

from __future__ import annotations

import numpy as np

from dse.native.compiled import compiled

# EVT 2.0: the upper 4 of 32 bits.
_CD_ON = 0x1  # and OFF below
_TIME_HIGH_2 = 0x8
_SKIPPED_2 = (0xA, 0xE, 0xF)  # trigger, others, continued
_HIGHS_2 = 1 << 28  # the time high wraps here: every 4.8 hours

# EVT 3.0: the upper 4 of 16 bits.
_ADDR_Y = 0x0
_ADDR_X = 0x2
_VECT_BASE_X = 0x3
_VECT_12 = 0x4
_VECT_8 = 0x5
_TIME_LOW = 0x6
_TIME_HIGH_3 = 0x8
_SKIPPED_3 = (0x7, 0xA, 0xE, 0xF)  # continued by 4 bits, trigger, others, continued by 12 bits
_HIGHS_3 = 1 << 12  # the time high wraps here: every 16.8 seconds

MOST_PER_WORD = 12
"""Events that one word of EVT 3.0 may hold."""

_HIGH, _LOW, _ROW, _BASE, _POLE = range(5)  # what is carried from word to word
NOTHING_STATED = (-1, 0, -1, -1, 0)


@compiled()
def _unwrapped(before, high, highs):  # type: ignore[no-untyped-def]
    """Return a time high that counts on at a wrap, which is a fall by more than 7/8 of its range."""
    if before < 0:
        return high
    wraps = before // highs
    if before % highs - high > highs // 8 * 7:
        wraps += 1
    return wraps * highs + high


@compiled()
def decode_evt2(words, carried, t_us, x, y, polarity):  # type: ignore[no-untyped-def]
    """Decode words of EVT 2.0.

    Args:
        words: (n,) uint32.
        carried: (5,) int64, what words before stated; updated.
        t_us: (n,) int64, filled; so are the next three.
        x: (n,) int32.
        y: (n,) int32.
        polarity: (n,) uint8.

    Returns:
        The number of events, of events left out before the first time high, of words of unknown type, and the
        first of these.
    """
    n, early, unknown, first_unknown = 0, 0, 0, -1
    for k in range(words.size):
        word = np.int64(words[k])
        kind = word >> 28
        if kind <= _CD_ON:
            if carried[_HIGH] < 0:
                early += 1
                continue
            t_us[n] = (carried[_HIGH] << 6) | ((word >> 22) & 0x3F)
            x[n] = (word >> 11) & 0x7FF
            y[n] = word & 0x7FF
            polarity[n] = kind
            n += 1
        elif kind == _TIME_HIGH_2:
            carried[_HIGH] = _unwrapped(carried[_HIGH], word & (_HIGHS_2 - 1), _HIGHS_2)
        elif kind not in _SKIPPED_2:
            unknown += 1
            if unknown == 1:
                first_unknown = k
    return n, early, unknown, first_unknown


@compiled()
def decode_evt3(words, k, carried, t_us, x, y, polarity):  # type: ignore[no-untyped-def]
    """Decode words of EVT 3.0 from word k on, until the next one might not fit.

    Args:
        words: (n,) uint16.
        k: where to begin.
        carried: (5,) int64, what words before stated; updated.
        t_us: (events,) int64, filled, at least MOST_PER_WORD; so are the next three.
        x: (events,) int32.
        y: (events,) int32.
        polarity: (events,) uint8.

    Returns:
        The word to go on with, the number of events, of events left out whose time high, row or vector base
        was not stated before, of words of unknown type, and the first of these.
    """
    n, early, unknown, first_unknown = 0, 0, 0, -1
    while k < words.size and n <= t_us.size - MOST_PER_WORD:
        word = np.int64(words[k])
        kind = word >> 12
        if kind == _ADDR_X or kind == _VECT_12 or kind == _VECT_8:
            wide = 12 if kind == _VECT_12 else 8
            column, pole, valid = carried[_BASE], carried[_POLE], word & ((1 << wide) - 1)
            if kind == _ADDR_X:
                column, pole, valid = word & 0x7FF, (word >> 11) & 1, np.int64(1)
            elif column >= 0:
                carried[_BASE] = column + wide
            stated = carried[_HIGH] >= 0 and carried[_ROW] >= 0 and column >= 0
            while valid:
                if valid & 1:
                    if stated:
                        t_us[n] = (carried[_HIGH] << 12) | carried[_LOW]
                        x[n] = column
                        y[n] = carried[_ROW]
                        polarity[n] = pole
                        n += 1
                    else:
                        early += 1
                column += 1
                valid >>= 1
        elif kind == _ADDR_Y:
            carried[_ROW] = word & 0x7FF
        elif kind == _VECT_BASE_X:
            carried[_BASE] = word & 0x7FF
            carried[_POLE] = (word >> 11) & 1
        elif kind == _TIME_LOW:
            carried[_LOW] = word & 0xFFF
        elif kind == _TIME_HIGH_3:
            high = _unwrapped(carried[_HIGH], word & (_HIGHS_3 - 1), _HIGHS_3)
            if high != carried[_HIGH]:  # cameras repeat it between two time lows
                carried[_LOW] = 0
            carried[_HIGH] = high
        elif kind not in _SKIPPED_3:
            unknown += 1
            if unknown == 1:
                first_unknown = k
        k += 1
    return k, n, early, unknown, first_unknown
