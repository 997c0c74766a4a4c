"""Flash of the C on Cortex-M before it is compiled: constant data, exactly, and code, from measured parts.

The parts are a least-squares fit to 113 compiled classifiers (ziglang 0.17.1, -O2): mostly networks, 38 of
counts, one or two of each encoder and of pooling, `receptors` with the arithmetic of doubles. Of these,
mostly small ones, flash is off by 2.5 % in the mean, at most by 14 % or 608 bytes.
"""

from __future__ import annotations

from collections.abc import Mapping

from dse.deploy.c.code import Code
from dse.deploy.form import ReceptorsForm, SendOnDeltaForm

_PARTS = {
    "base": (871.6, 715.7),
    "delayed_copies": (235.9, 340.0),
    "confidence": (70.9, 84.1),
    "cuba_lif": (299.8, 263.4),
    "xylo_lif": (214.1, 399.7),
    "xylo_output": (346.9, 236.7),
    "resonators": (276.3, 325.1),
    "mixed": (358.1, 452.1),
    "recurrent": (70.3, 49.3),
    "short_matrix": (-129.3, -79.1),
    "short_row": (32.0, 22.7),
    "add_bytes": (578.1, 607.7),
    "add_words": (499.9, 474.8),
    "add_sparse": (365.3, 395.8),
    "add_later": (374.4, 377.0),
    "held": (72.1, 97.5),
    "many_classes": (274.5, 331.9),
    "samples": (162.0, 268.3),
    "events": (314.0, 396.3),
    "receptors": (5072.5, 4958.2),
    "counting": (597.0, 462.9),
    "many_places": (569.0, 453.6),
    "two_places": (-185.3, -219.1),
    "several_words": (-119.4, -80.2),
    "nearest": (681.6, 649.0),
    "neighbours": (-27.6, 23.0),
    "bayes": (3847.8, 4215.7),
    "bayes_halves": (1170.4, 1009.3),
    "perceptron": (990.3, 3050.2),
    "integers": (588.8, 654.1),
    "integer_layers": (307.1, 265.6),
    "kernels": (929.4, 767.8),
    "convolutions": (1330.0, 1380.0),
    "several_convolutions": (200.0, 210.0),
    "levels": (473.0, 334.4),
    "extreme": (1182.9, 2964.6),
    "extreme_double": (4218.6, 4186.3),
    "doubles_again": (-1850.0, -1950.0),
}
"""Bytes of each part: on cores with the Thumb-2 instructions, and on a Cortex-M0+."""
CORTEX_M, CORTEX_M0_PLUS = ({name: sizes[k] for name, sizes in _PARTS.items()} for k in range(2))


def constant_bytes(code: Code) -> float:
    """Return the bytes of all constants: tables, names of classes, those of an encoder, pools of pixels."""
    encoder, pools = code.encoder, code.pooling
    n = code.table_bytes + sum(len(name.encode()) + 1 for name in code.classes)
    if isinstance(encoder, ReceptorsForm):
        n += 8 * (2 * encoder.n_sensors + encoder.kinds.size)
    elif isinstance(encoder, SendOnDeltaForm):
        n += (4 if encoder.takes_whole else 8) * len(encoder.first)
    elif pools is not None:
        _, _, columns, rows = pools.crop
        n += columns * (1 if pools.width <= 256 else 2) + rows * (1 if pools.height <= 256 else 2)
    return float(n)


def flash_bytes(code: Code, bytes_of_part: Mapping[str, float]) -> float:
    """Return code and constant data, in bytes."""
    instructions = sum(n * bytes_of_part[part] for part, n in code.parts().items())
    return float(round(constant_bytes(code) + instructions))
