"""A study: train the designs of a search space, keep what they measured, answer questions about them.

Designs are asked for in batches, a batch is trained to its end, and only then is the sampler told. Together
with seeds that belong to a design and a repeat, this makes results independent of the number of workers and
of interruptions: the same command on the same folder goes on, and ends with the same tables (but for the
seconds that training took).
"""
