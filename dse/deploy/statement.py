"""What a classifier follows from, as in-toto statement with provenance of SLSA, for tools that read these.

The same stands in bundle.json, from which `dse.deploy.reproduce` trains it once more. Sources: in-toto
Statement v1, SLSA Provenance v1 (REFERENCES.md).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from dse.base.records import Array

_DISTRIBUTIONS = {"dse": "dse-spiking"}
"""What packages are called on the package index, where it is another name."""
_PARAMETERS = ("design", "seed", "repeat", "refit", "precision")


def statement(
    sections: Mapping[str, Any],
    evidence: Mapping[str, Any],
    arrays: Mapping[str, Array],
    weights: Mapping[str, str],
) -> dict[str, Any]:
    """Return the statement about a classifier, as plain data; `weights`: their file -> its SHA-256."""
    sessions = evidence.get("environment") or [{}]
    versions: Mapping[str, str] = sessions[-1].get("versions", {})
    recordings = str(evidence.get("recordings") or "").split()
    return {
        "_type": "https://in-toto.io/Statement/v1",
        "subject": [{"name": name, "digest": {"sha256": x}} for name, x in weights.items()],
        "predicateType": "https://slsa.dev/provenance/v1",
        "predicate": {
            "buildDefinition": {
                "buildType": "urn:dse:training:1",
                "externalParameters": {
                    "sections": sections,
                    **{key: evidence[key] for key in _PARAMETERS if key in evidence},
                },
                "resolvedDependencies": [
                    *({"name": "recordings", "digest": {"sha256": each}} for each in recordings),
                    *(
                        {"uri": f"pkg:pypi/{_DISTRIBUTIONS.get(name, name)}@{version}"}
                        for name, version in versions.items()
                    ),
                ],
            },
            "runDetails": {
                "builder": {"id": "urn:dse", "version": {"python": sessions[-1].get("python", "")}},
                "metadata": {"startedOn": sessions[-1].get("started", "")},
                "byproducts": [{"name": "arrays", "digest": {"sha256": digest(arrays)}}],
            },
        },
    }


def digest(arrays: Mapping[str, Array]) -> str:
    """Return the SHA-256 of arrays: names, types, shapes and numbers in the order of the names."""
    found = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        little = np.asarray(array).astype(np.asarray(array).dtype.newbyteorder("<"))
        found.update(f"{name} {little.dtype.str} {little.shape}\n".encode())
        found.update(np.ascontiguousarray(little).tobytes())
    return found.hexdigest()
