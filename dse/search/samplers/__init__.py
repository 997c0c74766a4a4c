"""Samplers: which designs to train next. Contract and how to add one: `dse.search`."""
