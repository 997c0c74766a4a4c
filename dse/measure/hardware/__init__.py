"""What a network costs on a chip: cores, energy and time, from counts and a profile.

A profile (profiles/<name>.yaml) is data only: every number with its unit, source, evidence and range.
`cost.cost(profile.load(name), workload)` gives energies as intervals; to add a chip, add a file.
"""
