"""Flash of the C on Cortex-M before it is compiled: constant data, exactly, and code, from measured parts.

The parts are a least-squares fit to 113 compiled classifiers (ziglang 0.17.1, -O2): mostly networks, 38 of
counts, one or two of each encoder and of pooling, `receptors` with the arithmetic of doubles. Of these,
mostly small ones, flash is off by 2.5 % in the mean, at most by 14 % or 608 bytes.

Those of gcc 12.2.1 are fitted to 350 classifiers of `benchmarks.code_size`: flash of 140 others is off by
0.3 % in the mean on a Cortex-M4, at most by 3 % or 250 bytes.
"""

from __future__ import annotations

from collections.abc import Mapping

from dse.deploy.c.code import Code
from dse.deploy.form import ReceptorsForm, SendOnDeltaForm

_PARTS = {
    "base": (871.6, 715.7, 445.1, 510.3),
    "delayed_copies": (235.9, 340.0, 249.8, 269.7),
    "confidence": (70.9, 84.1, 63.8, 77.7),
    "cuba_lif": (299.8, 263.4, 293.3, 325.1),
    "xylo_lif": (214.1, 399.7, 372.8, 431.2),
    "xylo_output": (346.9, 236.7, 352.9, 296.3),
    "resonators": (276.3, 325.1, 259.0, 477.7),
    "mixed": (358.1, 452.1, 424.8, 574.2),
    "recurrent": (70.3, 49.3, 95.1, 106.5),
    "short_matrix": (-129.3, -79.1, -7.0, -87.8),
    "short_row": (32.0, 22.7, 15.2, 22.5),
    "add_bytes": (578.1, 607.7, 134.4, 179.4),
    "add_words": (499.9, 474.8, 45.6, 92.9),
    "add_sparse": (365.3, 395.8, 93.3, 89.4),
    "add_later": (374.4, 377.0, 11.7, 40.8),
    "held": (72.1, 97.5, 178.4, 145.1),
    "many_classes": (274.5, 331.9, -41.3, -55.1),
    "samples": (162.0, 268.3, 243.6, 420.5),
    "events": (314.0, 396.3, 191.7, 215.1),
    "real_samples": (162.0, 268.3, 1702.7, 5190.3),
    "receptors": (5072.5, 4958.2, 3552.3, 8311.9),
    "counting": (597.0, 462.9, -160.1, 1130.3),
    "many_places": (569.0, 453.6, -7.3, -7.9),
    "two_places": (-185.3, -219.1, -57.5, -54.9),
    "several_words": (-119.4, -80.2, 29.3, 36.5),
    "nearest": (681.6, 649.0, 748.8, -519.2),
    "neighbours": (-27.6, 23.0, 76.3, 76.5),
    "bayes": (3847.8, 4215.7, 4026.0, 7560.3),
    "bayes_halves": (1170.4, 1009.3, 238.5, 81.8),
    "perceptron": (990.3, 3050.2, 1110.0, 3490.1),
    "integers": (588.8, 654.1, 752.5, -544.8),
    "integer_layers": (307.1, 265.6, 147.2, 154.0),
    "kernels": (929.4, 767.8, 376.5, 431.5),
    "convolutions": (1330.0, 1380.0, 433.2, 502.6),
    "several_convolutions": (200.0, 210.0, 158.8, 142.0),
    "levels": (473.0, 334.4, 177.7, 199.3),
    "extreme": (1182.9, 2964.6, 1055.5, 2176.3),
    "extreme_double": (4218.6, 4186.3, 3060.1, 4224.7),
    "doubles_again": (-1850.0, -1950.0, -1692.7, -4447.1),
}
"""Bytes of each part: by clang on cores with Thumb-2 instructions and on a Cortex-M0+, by gcc on these."""
CORTEX_M, CORTEX_M0_PLUS = (
    {compiler: {name: sizes[k] for name, sizes in _PARTS.items()} for compiler, k in columns.items()}
    for columns in ({"clang": 0, "gcc": 2}, {"clang": 1, "gcc": 3})
)


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
