"""Classifiers of spike counts in windows."""
