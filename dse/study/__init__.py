"""A study: train the designs of a search space, keep what they measured, answer questions about them.

A stack of searches (`dse.study.searches`) says what is trained next, each with `ask` and `tell`: a new idea
is one file. The sampler proposes designs in batches; it receives results only after the whole batch is
trained. Seeds belong to a design and a repeat. Results are therefore independent of the number of workers
and of interruptions: the same command on the same folder resumes the study and ends with the same tables,
except for training times.
"""
