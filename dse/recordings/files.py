"""Where a data file named in a YAML is found on this machine."""

from __future__ import annotations

import os
from pathlib import Path

from dse.recordings import RecordingError


def locate(file: str, base: Path) -> Path:
    """Return where a data file is: absolute, beside the YAML (`base`), in $DSE_DATA, or here; first hit wins.

    Raises:
        RecordingError: it is in none of these places; the sentence lists them.
    """
    folders = [base, *(Path(x) for x in [os.environ.get("DSE_DATA", "")] if x), Path.cwd()]
    places = [Path(file)] if Path(file).is_absolute() else [folder / file for folder in folders]
    for place in places:
        if place.is_file():
            return place
    looked = ", ".join(str(x.parent) for x in places)
    hint = (
        ""
        if Path(file).is_absolute()
        else " (DSE_DATA names another folder, --set data.file=FILE another file)"
    )
    raise RecordingError(f"data file '{file}' not found; looked in {looked}{hint}")
