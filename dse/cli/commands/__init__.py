"""One module per command; `dse.cli` says what it must define."""
