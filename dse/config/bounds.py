"""How much a small file may ask for: bounds on work and memory, which `dse describe bounds` prints."""

from __future__ import annotations

MOST_YAML_BYTES = 1 << 20
MOST_YAML_VALUES = 100_000
MOST_TRIALS = 1_000_000
MOST_EPOCHS = 1_000_000
MOST_SAMPLES = 1_000_000
MOST_COLUMNS = 100_000
MOST_PIXELS = 1 << 24
MOST_STEPS = 1 << 26
UNCOMPRESSED_BYTES = 1 << 28
MOST_COMPRESSION = 200

BOUNDS = {
    "yaml_bytes": (MOST_YAML_BYTES, "bytes of a YAML file"),
    "yaml_values": (
        MOST_YAML_VALUES,
        "values of a YAML file; an alias counts with all that it names",
    ),
    "trials": (MOST_TRIALS, "trials of a study; a larger grid needs search.n_trials"),
    "epochs": (MOST_EPOCHS, "passes over the training samples"),
    "batch_size": (MOST_SAMPLES, "samples per weight update"),
    "columns": (MOST_COLUMNS, "columns of a CSV file"),
    "pixels": (MOST_PIXELS, "pixels of the frame of a file of events"),
    "steps": (MOST_STEPS, "steps of a recording, from its first event to its last one"),
    "compression": (
        MOST_COMPRESSION,
        f"times that an array of an .npz may be larger than it is stored, above {UNCOMPRESSED_BYTES} bytes",
    ),
}
"""Name -> largest value, of what."""
