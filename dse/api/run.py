"""To run a study from Python: a search space by name, file, mapping or object."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dse.api.study import Study
from dse.config import SearchSpace, load_space
from dse.study import explore


def run(
    space: SearchSpace | str | Path | Mapping[str, Any],
    results: str | Path = "results",
    *,
    jobs: int | None = None,
    progress: bool = True,
    on_trial: Callable[[dict[str, Any]], object] | None = None,
) -> Study:
    """Train the missing runs of a study and return it; this also resumes an interrupted study.

    Args:
        space: what to explore: the name of a shipped search space, a YAML file, its sections as a mapping, or
            what `load_space` returns.
        results: the study's folder is made in here, named as the study.
        jobs: number of worker processes; None: that of the search space.
        progress: show it on stderr.
        on_trial: called with the row of each trial that ends here, in the order in which they end; an
            exception of its own ends the run, which the same call resumes.

    Raises:
        ConfigError: faults of the search space; the folder holds a study of another one, or of other
            recordings; or the device is missing.
        RecordingError: the recordings do not fit the search space.
        StoreError: the folder is in use or cannot be written; nothing finished is lost.
        TypeError: an argument of another kind.
        KeyboardInterrupt: after Ctrl-C; finished runs and the tables are written.

    >>> study = dse.run("my_touch.yaml", progress=False)
    >>> study.trials[["family", "status"]].values.tolist()
    [['snn', 'finished']]
    """
    given: Mapping[str, object] = {"results": results, "jobs": jobs, "on_trial": on_trial}
    if not isinstance(given["results"], str | Path):
        raise TypeError(f"results must be the path of a folder, got {results!r}")
    if jobs is not None and (isinstance(jobs, bool) or not isinstance(given["jobs"], int) or jobs < 1):
        raise TypeError(f"jobs must be an integer >= 1, got {jobs!r}")
    if on_trial is not None and not callable(given["on_trial"]):
        raise TypeError(f"on_trial must be a function of a row, got {on_trial!r}")
    loaded = space if isinstance(space, SearchSpace) else load_space(space, check_data=True)
    study = explore.run(loaded, results, jobs=jobs, progress=progress, on_trial=on_trial)
    return Study(study.folder)
