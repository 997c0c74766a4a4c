"""`dse note`: notes and pins on designs of a study."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dse.cli.answer import Answer
from dse.cli.fields import argument, flag, formats

GROUP = "choose"
HELP = "write a note on a design, pin it, or list the notes of a study"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    results: str = argument("RESULTS", "folder of a study")
    design: str | None = argument("DESIGN", "a trial such as 3, or a point of one such as 3.12", None)
    text: str | None = argument("TEXT", "the note; '' removes it (without TEXT: the note stays)", None)
    pin: bool | None = flag("list the design first", None)
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Write the note, if there is one, and return all notes of the study."""
    from dse.store import StoreError
    from dse.study import notes

    folder = Path(arguments.results)
    if not (folder / "search_space.yaml").is_file():
        raise StoreError(f"{folder}: is not the folder of a study: there is no search_space.yaml")
    listed = notes.of(folder)
    if arguments.design is not None:
        trial, point = notes.parse_design(arguments.design)
        before = next((note for note in listed if (note.trial, note.point) == (trial, point)), None)
        if arguments.text is not None or arguments.pin is not None:
            text = arguments.text if arguments.text is not None else before.text if before else ""
            pinned = arguments.pin if arguments.pin is not None else bool(before and before.pinned)
            listed = notes.write(folder, trial, point, text, pinned)
        else:
            listed = [before] if before else []
    elif arguments.pin is not None:
        raise StoreError("--pin needs a DESIGN")
    rows = [
        {"design": note.design, "pinned": note.pinned, "note": note.text, "written": note.at}
        for note in listed
    ]
    return Answer(rows, [] if rows else ["no notes"], all_rows=True)
