"""Flash of the C on Cortex-M before it is compiled: constant data, exactly, and code, from measured parts.

The parts are a least-squares fit to 350 compiled classifiers, 50 of each kind of `benchmarks.code_size`.
On a Cortex-M4, flash of 140 others is off by 1.1 % in the mean, at most by 11 % or 734 bytes, by clang
(ziglang 0.17.1, -O2), and by 0.4 %, at most by 3 % or 258 bytes, by gcc (12.2.1, -O2).
"""

from __future__ import annotations

from collections.abc import Mapping

from dse.deploy.c.code import Code
from dse.deploy.form import ReceptorsForm, SendOnDeltaForm

_PARTS = {
    "base": (1051.0, 885.4, 446.0, 488.5),
    "delayed_copies": (412.7, 486.6, 250.7, 284.2),
    "confidence": (99.2, 88.8, 65.4, 84.8),
    "cuba_lif": (312.5, 301.3, 290.7, 318.9),
    "xylo_lif": (361.3, 417.8, 372.4, 428.6),
    "xylo_output": (27.5, 93.0, 348.3, 289.1),
    "resonators": (321.3, 383.1, 257.1, 468.6),
    "mixed": (409.9, 473.9, 424.9, 577.4),
    "recurrent": (98.3, 82.2, 94.6, 112.7),
    "short_matrix": (-152.3, -188.1, -7.5, -48.4),
    "short_row": (33.7, 27.9, 15.4, 18.1),
    "add_bytes": (534.3, 639.5, 135.1, 175.9),
    "add_words": (420.3, 395.2, 46.8, 93.6),
    "add_sparse": (299.0, 342.8, 94.5, 89.2),
    "add_later": (380.8, 279.1, 6.8, 37.7),
    "held": (170.9, 259.1, 176.7, 142.0),
    "many_classes": (149.0, 124.9, -38.9, -36.7),
    "samples": (419.4, 385.2, 250.8, 279.6),
    "events": (245.5, 249.4, 192.9, 216.6),
    "real_samples": (2215.1, 2125.5, 1743.3, 5285.0),
    "divided_samples": (-5.8, 289.6, 10.8, 516.0),
    "divided_real_samples": (2328.1, 2202.0, 1554.8, 3138.6),
    "receptors": (4799.3, 4760.7, 3617.4, 8468.4),
    "counting": (786.9, 644.0, -154.6, 1150.9),
    "many_places": (162.1, 182.8, -6.6, -10.5),
    "two_places": (-275.0, -269.5, -55.9, -53.7),
    "several_words": (-74.8, -80.8, 28.9, 33.7),
    "nearest": (441.6, 481.4, 737.8, -536.3),
    "neighbours": (367.1, 247.6, 79.6, 74.6),
    "bayes": (4266.4, 4538.6, 4036.1, 7553.8),
    "bayes_halves": (277.8, 229.2, 165.0, -113.2),
    "perceptron": (1013.6, 3061.4, 1108.9, 3478.8),
    "integers": (477.1, 545.1, 746.3, -563.3),
    "integer_layers": (396.4, 377.5, 147.3, 154.7),
    "kernels": (1286.6, 1111.9, 376.7, 431.4),
    "convolutions": (1106.8, 1177.2, 433.3, 503.0),
    "several_convolutions": (382.5, 366.0, 158.8, 141.3),
    "levels": (468.6, 470.9, 177.7, 199.1),
    "extreme": (1184.2, 2956.5, 1053.1, 2171.3),
    "extreme_double": (4317.0, 4318.0, 3076.2, 4303.6),
    "doubles_again": (-1840.3, -2014.8, -1866.4, -4858.9),
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
