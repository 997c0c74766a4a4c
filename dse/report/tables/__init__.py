"""One file per paper, named as in `published.yaml`: what of ours stands beside its results.

`OURS` holds a function per result, by its key in `published.yaml`. `UNPRINTED`, where there is one, holds
values of ours that belong beside the printed ones, by name. `labels(part)`, where there is one, returns
the conditions of the designs of a study, such as the task.
"""
