"""Classifiers of time surfaces."""
