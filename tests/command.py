"""What a command answers, as a document."""

import json

from dse.cli import main


def document(capsys, *arguments, code=0):
    """Return the JSON document that a command prints, whose exit code must be `code`."""
    capsys.readouterr()
    assert main([*map(str, arguments), "--json"]) == code, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)
