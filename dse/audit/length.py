"""How long a recording lasts, and which part of its window has spikes."""

from __future__ import annotations

import numpy as np

from dse.audit.material import Material, spikes_per_step
from dse.audit.rows import AuditRow
from dse.audit.totals import best_of_readers, is_shortcut, weight_of
from dse.records import Floats, Ints


def rows(material: Material) -> list[AuditRow]:
    """Return a row for the length of recordings, where it varies, and one for the active part of windows.

    The length of a recording is no shortcut of windows that all have one length; the active part may show it.
    """
    audit = []
    lengths = np.log(np.maximum(material.lengths, 1.0))[:, None]
    if np.ptp(lengths[material.train]):
        score = material.read_alone(lengths)
        explained = weight_of(material, score)
        verdict = f"the length of a recording explains {explained}; windows of one length hide it"
        audit.append(material.row("length of the recording", score, verdict))
    train, validation = (_active(material, samples) for samples in (material.train, material.validation))
    if np.ptp(train, axis=0).any():
        score = best_of_readers(material, train, validation)
        verdict = f"where the spikes of a window begin and end explains {weight_of(material, score)}"
        audit.append(
            material.row(
                "active part of the window",
                score,
                verdict,
                shortcut=is_shortcut(material, score),
                remedy="window.n_steps: no longer than the shortest touch",
            )
        )
    return audit


def _active(material: Material, samples: Ints) -> Floats:
    """Return the first and the last step with a spike, (samples, 2); both -1 where there is none."""
    data = material.dataset
    active = spikes_per_step(data.spikes, samples, data.start[samples], data.n_steps) > 0
    last = data.n_steps - 1 - active[:, ::-1].argmax(axis=1)
    ends = np.stack([active.argmax(axis=1), last], axis=1).astype(np.float64)
    ends[~active.any(axis=1)] = -1
    return ends
