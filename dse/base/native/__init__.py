"""What every compiled kernel stands on: Numba functions cached on disk, and vectors as values in them."""
