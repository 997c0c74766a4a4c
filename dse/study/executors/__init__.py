"""Executors of jobs: where the work of a study runs.

Each is built on a `concurrent.futures.Executor`: joblib's loky on this machine, Dask on many. `Executor` in
`work` is what `dse.study.workers` needs of one.
"""
