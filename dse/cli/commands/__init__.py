"""One module per command; `dse.cli` lists the names that it must define."""
