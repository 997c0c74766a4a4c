"""One file per paper: what of ours stands beside its results.

`OURS` holds a function per result, by its key in `published.yaml`. `UNPRINTED`, where there is one, holds
values of ours that belong beside the printed ones, by name. `labels(part)`, where there is one, returns
the conditions of the designs of a study, such as the task.
"""

from dse_papers.report.tables import (
    elm_receptors,
    realtime_texture,
    temporal_spatiotemporal,
    texture_velocity,
    threshold_encoding,
)

TABLES = {
    "realtime_texture": realtime_texture,
    "temporal_spatiotemporal": temporal_spatiotemporal,
    "texture_velocity": texture_velocity,
    "threshold_encoding": threshold_encoding,
    "elm_receptors": elm_receptors,
}
"""Name of a paper -> its file."""
