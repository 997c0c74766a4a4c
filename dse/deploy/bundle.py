"""A bundle: the folder that `dse pick --export` writes and `dse evaluate` runs.

bundle.json   schema, how recordings become spikes, the decision rule, the classes, the record, the evidence
weights.npz   the network: float weights, 8-bit weights, decays, thresholds
README.md     the same for people
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dse import store
from dse.neurons import cuba_lif
from dse.records import Array, Network
from dse.store import StoreError

SCHEMA = "dse/bundle/1"
_WEIGHTS = "weights.npz"


class BundleError(ValueError):
    """A folder that is no bundle, a damaged one, or one of a newer schema, in one line."""


@dataclass(frozen=True)
class Bundle:
    """A classifier that can be deployed.

    network: what runs.
    sections: resolved data, task, window, preprocessing, encoder, model and training of its design.
    classes: names of the outputs.
    phi, theta: the decision rule; both None for the full read-out.
    record: the design point, column -> value.
    evidence: where the numbers come from.
    """

    network: Network
    sections: Mapping[str, Any]
    classes: tuple[str, ...]
    phi: float | None
    theta: float | None
    record: Mapping[str, Any]
    evidence: Mapping[str, Any]


def write(bundle: Bundle, folder: Path) -> None:
    """Publish a bundle; a bundle that is there already is replaced.

    Raises:
        BundleError: the folder holds something else.
        StoreError: it cannot be written.
    """
    if folder.exists() and not (folder / "bundle.json").is_file() and not _is_empty(folder):
        raise BundleError(f"{folder}: exists and is no bundle; choose another folder to export to")
    with store.published(folder) as temporary:
        temporary.mkdir()
        store.save_arrays(temporary / _WEIGHTS, weights(bundle.network))
        document = {
            "schema": SCHEMA,
            "sections": bundle.sections,
            "classes": bundle.classes,
            "decision": {
                "phi": bundle.phi,
                "theta": bundle.theta,
                "undecided": "argmax at the end, lowest class on ties",
            },
            "record": bundle.record,
            "evidence": bundle.evidence,
            "files": {_WEIGHTS: store.checksum(temporary / _WEIGHTS)},
        }
        store.write_json(temporary / "bundle.json", document)
        (temporary / "README.md").write_text(_readme(bundle), encoding="utf-8")
        store.remove(folder)


def read(folder: str | Path) -> Bundle:
    """Return a bundle after checking that it is whole.

    Raises:
        BundleError: it is not, or its schema is newer than this reads.
    """
    path = Path(folder)
    try:
        document = store.read_json(path / "bundle.json")
        if not isinstance(document, dict) or not str(document.get("schema", "")).startswith("dse/bundle/"):
            raise BundleError(f"{path / 'bundle.json'}: is no bundle of dse")
        if document["schema"] != SCHEMA:
            raise BundleError(
                f"{path / 'bundle.json'}: schema is {document['schema']}, this version of dse reads {SCHEMA}"
            )
        for name, expected in document["files"].items():
            if not (path / name).is_file():
                raise BundleError(f"{path / name}: is missing")
            if store.checksum(path / name) != expected:
                raise BundleError(f"{path / name}: is damaged (its checksum differs)")
        return Bundle(
            network=store.network_of(store.load_arrays(path / _WEIGHTS)),
            sections=document["sections"],
            classes=tuple(document["classes"]),
            phi=document["decision"]["phi"],
            theta=document["decision"]["theta"],
            record=document["record"],
            evidence=document["evidence"],
        )
    except StoreError as error:
        raise BundleError(str(error)) from error
    except (KeyError, TypeError, AttributeError) as error:
        raise BundleError(f"{path / 'bundle.json'}: lacks or garbles {error}") from error


def weights(network: Network) -> dict[str, Array]:
    """Return a network's arrays and, beside each float weight matrix, the 8-bit one that a chip holds.

    An 8-bit weight w8 in [-128, 127] stands for w8 / 32 (dse.neurons.cuba_lif.quantise).
    """
    arrays = store.network_arrays(network)
    for k, layer in enumerate(network.layers):
        for name, matrix in (("weight", layer.weight), ("recurrent", layer.recurrent)):
            if matrix is not None:
                arrays[f"{k}/{name}_8bit"] = np.rint(cuba_lif.quantise(matrix) * 32).astype(np.int8)
    return arrays


def _is_empty(folder: Path) -> bool:
    return folder.is_dir() and not any(folder.iterdir())


def _readme(bundle: Bundle) -> str:
    sizes = "-".join(map(str, bundle.network.sizes))
    if bundle.phi is None:
        rule = "The class with most output spikes at the end of the window (lowest on ties)."
    else:
        rule = (
            f"At the first step with more than {bundle.phi:g} output spikes, of which one class has a share "
            f"of {bundle.theta:g} or more: that class. Else the class with most at the end (lowest on ties)."
        )
    record = "\n".join(f"| {name} | {value} |" for name, value in bundle.record.items())
    return f"""# {bundle.evidence.get("study", "dse")}: a spiking classifier of {", ".join(bundle.classes)}

A {sizes} network of current-based leaky integrate-and-fire neurons ({bundle.network.arithmetic} arithmetic).

    dse evaluate THIS_FOLDER --data RECORDINGS

**Decision.** {rule}

**Weights.** `weights.npz` holds per layer k (0 is nearest the input): `k/weight` (neuron, input) as trained,
`k/weight_8bit` what runs on a chip (value / 32), `k/decay_current` and `k/decay_voltage` in 1/4096, and
`k/threshold` in 1/64. Input column d * {bundle.network.n_channels} + c is channel c, `delays[d]` steps ago.

**Spikes.** How recordings become input spikes is in `bundle.json`, `sections`.

| measured (validation unless it says test) | |
| --- | --- |
{record}
"""
