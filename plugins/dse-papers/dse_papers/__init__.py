"""Model families, figures and printed numbers of published systems: a plugin of `dse`."""
