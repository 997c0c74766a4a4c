"""A study: train the designs of a search space, keep what they measured, answer questions about them.

The sampler proposes designs in batches; it receives results only after the whole batch is trained. Seeds
belong to a design and a repeat. Results are therefore independent of the number of workers and of
interruptions: the same command on the same folder resumes the study and ends with the same tables, except
for training times.
"""
