"""What everything rests on: records, the registry of components, seeds, kernels, trust, plain text."""
