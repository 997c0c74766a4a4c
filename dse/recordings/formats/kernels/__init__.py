"""Compiled loops of formats whose bytes must be read one after the other; imported where a file is read."""
