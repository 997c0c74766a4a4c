"""Verilog of spiking networks: a form becomes the numbers of a circuit, and tools simulate and place it."""
