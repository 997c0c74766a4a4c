"""One file per command of `dse`; what it must define: `dse.cli`."""
