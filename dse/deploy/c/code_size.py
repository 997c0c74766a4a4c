"""Flash of the C on Cortex-M before it is compiled: constant data, exactly, and code, from measured parts.

The parts are a least-squares fit to 60 compiled networks (ziglang 0.17.1, -O2), those of `xylo_lif` to 9,
and the code of encoders and pooling that of one or two designs each, of `receptors` with the
arithmetic of doubles. On networks left out of the fit, flash is off by 0.6 % in the mean, at most by 4.3 % or
400 bytes. Those of classifiers of counts are fitted to 50; of 20 others, flash is off by at most 197 bytes.
Those of integers and of kernels are the code of three to five of each.
"""

from __future__ import annotations

from collections.abc import Mapping

from dse.deploy.c.code import Code
from dse.deploy.form import Frame, ReceptorsForm, SendOnDeltaForm

_PARTS = {
    "base": (1245.0, 1276.9),
    "delayed_copies": (397.7, 496.0),
    "confidence": (40.3, 67.0),
    "cuba_lif": (317.2, 347.5),
    "xylo_lif": (360.0, 350.0),
    "xylo_output": (94.0, 140.0),
    "resonators": (318.1, 421.0),
    "mixed": (424.8, 512.6),
    "recurrent": (101.3, 94.1),
    "short_matrix": (-163.3, -250.9),
    "short_row": (31.4, 39.8),
    "add_bytes": (628.4, 607.6),
    "add_words": (376.7, 345.8),
    "add_sparse": (264.0, 264.2),
    "add_later": (517.2, 424.2),
    "held": (254.4, 170.5),
    "many_classes": (165.6, 135.9),
    "samples": (290.0, 385.0),
    "events": (390.0, 395.0),
    "receptors": (4400.0, 4680.0),
    "counting": (650.0, 600.0),
    "many_places": (263.0, 243.0),
    "two_places": (-179.0, -221.0),
    "several_words": (186.0, 144.0),
    "nearest": (455.0, 432.0),
    "neighbours": (327.0, 239.0),
    "bayes": (4272.0, 4491.0),
    "bayes_halves": (1080.0, 754.0),
    "perceptron": (1039.0, 3008.0),
    "integers": (440.0, 711.0),
    "integer_layers": (546.0, 649.0),
    "kernels": (820.0, 510.0),
    "levels": (560.0, 330.0),
    "extreme": (1123.0, 2961.0),
    "extreme_double": (4234.0, 4254.0),
    "doubles_again": (-1850.0, -1950.0),
}
"""Bytes of each part: on cores with the Thumb-2 instructions, and on a Cortex-M0+."""
CORTEX_M, CORTEX_M0_PLUS = ({name: sizes[k] for name, sizes in _PARTS.items()} for k in range(2))


def footprint(code: Code) -> dict[str, float]:
    """Return ram_bytes, all static data as a compiler lays it out, and table_bytes, constants.

    The stack holds a few words more.
    """
    return {"ram_bytes": float(code.ram_bytes), "table_bytes": float(code.table_bytes)}


def constant_bytes(code: Code) -> float:
    """Return the bytes of all constants of a code."""
    return float(code.table_bytes + other_constants(code))


def flash_bytes(code: Code, bytes_of_part: Mapping[str, float]) -> float:
    """Return code and constant data, in bytes."""
    instructions = sum(n * bytes_of_part[part] for part, n in code.parts().items())
    return float(round(constant_bytes(code) + instructions))


def other_constants(plan: Frame) -> int:
    """Return the bytes of constants beside the tables: names of classes, pools of pixels."""
    names = sum(len(name.encode()) + 1 for name in plan.classes)
    if isinstance(plan.encoder, ReceptorsForm):
        return names + 8 * (2 * plan.encoder.n_sensors + plan.encoder.kinds.size)
    if isinstance(plan.encoder, SendOnDeltaForm):
        return names + (4 if plan.encoder.takes_whole else 8) * len(plan.encoder.first)
    if plan.pooling is None:
        return names
    _, _, columns, rows = plan.pooling.crop
    pools = plan.pooling
    return names + columns * (1 if pools.width <= 256 else 2) + rows * (1 if pools.height <= 256 else 2)
