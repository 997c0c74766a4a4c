"""A study as notebooks and scripts use it."""

from __future__ import annotations

import functools
import html
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse.api.choice import Choice, choose
from dse.api.front import front_of
from dse.base import registry
from dse.base.native.extras import MissingExtra
from dse.config import SearchSpace, load_space
from dse.config.faults import known_names
from dse.show.figures import Results, draw
from dse.skyline import front
from dse.skyline.front import Skyline
from dse.study import results
from dse.study.question import Question, texts

if TYPE_CHECKING:
    import optuna
    import pandas
    import plotly.graph_objects

    from dse.api.widget import Page
    from dse.deploy.bundle import Bundle

_MOST_ROWS = 10  # of the table in a notebook


class Study(results.Study):
    """The results in a study's folder: `trials`, `points()`, `skyline()`, `best()`, `pick()`, `plot`."""

    def __len__(self) -> int:
        """Return the number of trials."""
        return len(self.trials)

    def __bool__(self) -> bool:
        """Return True: a study without trials is a study."""
        return True

    def __repr__(self) -> str:
        trials = self.trials
        counts = [f"{n} {status}" for status, n in trials["status"].value_counts().items()]
        finished = trials[trials["status"] == "finished"]
        most = f", accuracy up to {finished['accuracy'].max():.3f}" if len(finished) else ""
        return f"<Study {self.folder.name}: {', '.join(counts) or 'no trials'}{most}; {self.folder}>"

    def _repr_html_(self) -> str:
        """Return the first rows of the front, for notebooks."""
        title = f"<p>{html.escape(repr(self))}</p>"
        points = self.points()
        if points.empty:
            return title
        goals = self.objectives
        names = [name for name, _ in goals]
        by = [name for name in ("task",) if name in points and points[name].nunique() > 1]
        rows = front.skyline(points, goals).rows
        distinct = rows.drop_duplicates(["trial", *names])
        shown: pandas.DataFrame = distinct.head(_MOST_ROWS)[["trial", *by, *names]]
        more = f"<p>{len(distinct) - len(shown)} more: <code>study.skyline()</code></p>"
        table = shown.to_html(index=False, float_format=lambda x: f"{x:.4g}", border=0)
        return title + table + (more if len(distinct) > len(shown) else "")

    def skyline(
        self,
        objectives: str | Sequence[Any] | Mapping[str, str] | None = None,
        where: str | Sequence[str] | None = None,
        by: str | Sequence[str] | None = None,
        *,
        beside: Sequence[str | Path] = (),
        **options: Any,
    ) -> Skyline:
        """Return the non-dominated points and notes on what was left out.

        Args:
            objectives: 'accuracy:max,energy_uj:min', pairs, or a mapping; None: those of the search space.
            where: condition such as "n_weights <= 5000", or several.
            by: columns whose values have separate fronts, beside hardware and task.
            beside: other studies, or tables, whose points compete; column `study` tells which is which.
            options: hardware, oversize, contacts_per_hour, targets, confidence and draws, as of
                `dse.study.question.Question`.

        Raises:
            ExpressionError: an unknown column, or a condition that cannot be read.
            TypeError: an argument of another kind, or out of range.

        >>> front = study.skyline("accuracy:max,energy_uj:min", where="task == 'profile'", hardware="mcu_m33")
        >>> front.rows["family"].iloc[0]
        'mlp'
        """
        question = Question.of(objectives=objectives, where=where, by=by, **options)
        return front_of([self.folder, *beside], question)

    def pick(self, budgets: str | Sequence[str] = (), maximise: str | None = None, **options: Any) -> Choice:
        """Return the best point within the budgets (`row`), or None and the nearest ones (`nearest`).

        Args:
            budgets: conditions such as "energy_uj <= 50", one or several.
            maximise: column to maximise; None: the first objective that is maximised.
            options: as of `skyline`.

        Raises:
            ExpressionError: an unknown column, or a budget that cannot be read.
            TypeError: an argument of another kind.

        >>> study.pick(["task == 'texture'", "n_weights <= 20000"], hardware="mcu_m4")
        <Choice trial 0 of example on mcu_m4: accuracy 0.5799, n_weights 1.029e+04, energy_uj 1157>
        """
        columns = texts(maximise, "maximise")
        return choose(
            self.folder, texts(budgets, "budgets"), columns[0] if columns else None, Question.of(**options)
        )

    def best(self, *budgets: str, **options: Any) -> pandas.Series[Any]:
        """Return the best point within the budgets: `study.best("n_weights <= 5000", hardware="mcu_m4")`.

        Args:
            budgets: conditions, as of `pick`.
            options: as of `pick`.

        Raises:
            NothingFeasible: no point meets every budget; the text says what the nearest one misses.
            ExpressionError: as of `pick`.
            TypeError: as of `pick`.

        >>> study.best("energy_uj <= 300", "task == 'profile'", hardware="mcu_m4")["family"]
        'mlp'
        """
        conditions = [text for each in budgets for text in texts(each, "budgets")]
        return self.pick(conditions, **options).found

    def export(
        self,
        point: Choice | Mapping[str, Any] | pandas.Series[Any],
        folder: str | Path,
        targets: str | Sequence[str] = (),
        recordings: str | Path | None = None,
    ) -> Bundle:
        """Write a design point as a bundle (`dse.export`).

        >>> study.export(study.best("n_weights <= 20000"), "small").targets
        {}
        """
        from dse.deploy.export import export

        row = {str(name): value for name, value in point.items()}
        return export(self, row, folder, texts(targets, "targets"), recordings)

    @property
    def plot(self) -> Plots:
        """The figures: `study.plot.front()`, `study.plot.surface(point)`, ...; dir() lists them."""
        return Plots(self)

    def page(self, hardware: str | Sequence[str] = (), *, height_px: int = 900) -> Page:
        """Return the page as a widget for notebooks; its `row` is the design point that a reader chose in it.

        Args:
            hardware: names or files of profiles to price the points on; none: the profiles of the study.
            height_px: of the widget.

        Raises:
            MissingExtra: anywidget is not installed.
            ConfigError: a hardware profile does not exist or is wrong.
            TypeError: an argument of another kind.

        >>> page = study.page("mcu_m4")  # and, once a reader has chosen: study.export(page.row, "bundle")
        """
        given: object = height_px
        if not isinstance(given, int) or given < 1:
            raise TypeError(f"height_px must be an integer >= 1, got {height_px!r}")
        if find_spec("anywidget") is None:
            raise MissingExtra("a page in a notebook needs anywidget: pip install 'dse-spiking[notebook]'")
        from dse.api.widget import Page

        return Page(self, texts(hardware, "hardware"), height_px)

    def to_optuna(self, storage: str | None = None) -> optuna.Study:
        """Return the trials as a study of Optuna, for its own plots and importances.

        Args:
            storage: where it is written for `optuna-dashboard`, such as sqlite:///search.db; None: in memory.

        Raises:
            ConfigError: a component of the search space is not installed here.

        >>> len(study.to_optuna().trials)
        16
        """
        from dse.study.as_optuna import as_optuna

        return as_optuna(self.folder, storage)


def open(folder: str | Path) -> Study:
    """Return the study in a folder.

    Raises:
        StoreError: there is none, or nothing has finished yet.
        TypeError: the folder is neither text nor path.

    >>> dse.open("results/example")
    <Study example: 16 finished, accuracy up to 0.903; results/example>
    """
    given: object = folder
    if not isinstance(given, str | Path):
        raise TypeError(f"folder must be the path of a study's folder, got {folder!r}")
    return Study(results.open(folder).folder)


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
    from dse.study import explore

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


class Plots:
    """The figures of a study; a figure's keys (`dse describe figures NAME`) are arguments of its method.

    A first argument without a name is the design: a trial's number or a row with one, such as `study.best()`.
    """

    def __init__(self, results: Results) -> None:
        """Draw figures of these results."""
        self._results = results

    def __getattr__(self, name: str) -> functools.partial[plotly.graph_objects.Figure]:
        """Return what draws a figure.

        Raises:
            AttributeError: there is no such figure.
        """
        figures = registry.known("figures")
        if name not in figures:
            where = registry.elsewhere("figures", name)
            raise AttributeError(f"unknown figure '{name}'{where}; {known_names(name, figures)}")
        return functools.partial(self._drawn, name)

    def _drawn(self, name: str, design: Any = None, **keys: Any) -> plotly.graph_objects.Figure:
        """Draw a figure.

        Raises:
            ValueError: the figure has no such key, needs another one, or has nothing to show.
            TypeError: the design is something else.
        """
        return draw(self._results, name, **({} if design is None else {"trial": _trial(design)}), **keys)

    def __dir__(self) -> list[str]:
        return sorted(registry.known("figures"))

    def __repr__(self) -> str:
        return f"<figures: {', '.join(dir(self))}>"


def _trial(design: Any) -> int:
    """Return the number of a trial, given as such or by a row of a table."""
    try:
        return int(design["trial"] if isinstance(design, Mapping) or hasattr(design, "items") else design)
    except (TypeError, ValueError, KeyError):
        raise TypeError(f"design must be a trial's number or a row of a table, got {design!r}") from None
