"""The bill of materials of this environment: every installed package, its version and licence, CycloneDX 1.6.

python -m benchmarks.materials > materials.json
"""

from __future__ import annotations

import importlib.metadata
import json
import re
from typing import Any

DSE = "dse-spiking"  # what the distribution of package `dse` is called
_CLASSIFIER = "License :: OSI Approved :: "


def licence(package: importlib.metadata.Distribution) -> str:
    """Return the licence that a package states, an SPDX expression where it has one; '' for none."""
    about = package.metadata
    stated = about.get("License-Expression") or about.get("License") or ""
    if stated not in ("", "UNKNOWN") and "\n" not in stated and len(stated) < 100:
        return stated
    names = [x.removeprefix(_CLASSIFIER) for x in about.get_all("Classifier") or () if _CLASSIFIER in x]
    return " AND ".join(names) or stated.partition("\n")[0].strip()


def materials() -> dict[str, Any]:
    """Return the bill of materials, the packages by name."""
    installed = {
        re.sub(r"[-_.]+", "-", each.metadata["Name"]).lower(): each
        for each in importlib.metadata.distributions()
    }
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {"type": "library", "name": DSE, "version": installed[DSE].version}},
        "components": [
            {
                "type": "library",
                "name": name,
                "version": each.version,
                "purl": f"pkg:pypi/{name}@{each.version}",
                "licenses": [{"license": {"name": text}}] if (text := licence(each)) else [],
            }
            for name, each in sorted(installed.items())
            if name != DSE
        ],
    }


if __name__ == "__main__":
    print(json.dumps(materials(), indent=1))
