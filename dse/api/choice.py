"""The best design point within budgets, with all that can be asked for: chips, confidence, duty, targets."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse.api.front import measured
from dse.skyline.constraints import ExpressionError, named_columns
from dse.skyline.pick import budgeted, pick, sure_pick
from dse.skyline.table import Goal
from dse.store import StoreError, runs_of
from dse.study import corrected, health, held, pricing, resampling
from dse.study.question import DRAWS, Question
from dse.study.results import open as open_study
from dse.study.rivals import of_study

if TYPE_CHECKING:
    import pandas

    from dse.deploy.bundle import Bundle
    from dse.skyline.rivals import Rivals
    from dse.study.results import Study

_IDENTITY = ("trial", "family", "phi", "theta", "read_out_ms", "weight_bits", "pruned_after", "hardware")
_OPTIONAL = (
    *("power_mw", "front_share", "confidence"),
    *("target", "ram_bytes", "table_bytes", "flash_bytes", "cycles"),
    *("cells", "memory_blocks", "most_cycles_per_step"),
)


TRAINED = ("train", "validation")
"""Parts of a split that a pick may be trained on once more: all but the test set."""


class NothingFeasible(ValueError):
    """No design point meets every budget; `nearest` holds the nearest ones."""

    def __init__(self, text: str, nearest: pandas.DataFrame) -> None:
        """Keep the nearest points."""
        super().__init__(text)
        self.nearest = nearest


@dataclass(frozen=True, repr=False, eq=False)
class Choice(Mapping[str, Any]):
    """The best design point within the budgets, or the nearest ones; a mapping from column to value.

    row: its columns, None if no point meets every budget.
    nearest: in that case, the nearest points, as of `dse.skyline.pick.Pick`.
    notes: what was left out, what decided, and what to look at.
    goals: what was maximised, then the other objectives.
    targets: that the points were looked at on.
    results: folder of the study, or the table.
    question, budgets: what was asked.
    """

    row: pandas.Series[Any] | None
    nearest: pandas.DataFrame
    notes: list[str]
    goals: list[Goal]
    targets: list[str]
    results: Path
    question: Question = Question()  # noqa: RUF009 (frozen)
    budgets: Sequence[str] = ()

    @property
    def rivals(self) -> list[Rivals]:
        """Whether to spike, among the points within the budgets for the task and the chip of the pick.

        Nothing of a table, or where all families of a study spike, or none does.
        """
        if self.row is None or not self.results.is_dir():
            return []
        same = {name: str(self.row[name]) for name in ("task", "hardware") if name in self.row}
        question = replace(self.question, where=tuple(f"{name} == {text!r}" for name, text in same.items()))
        return list(of_study(open_study(self.results), question, self.budgets))

    @property
    def found(self) -> pandas.Series[Any]:
        """The columns of the design point.

        Raises:
            NothingFeasible: no point meets every budget; the text says what the nearest one misses.
        """
        if self.row is not None:
            return self.row
        missed = [str(name) for name in self.nearest if str(name).startswith("missed ")]
        text = "; ".join(self.notes)
        if len(self.nearest):
            nearest = self.nearest.iloc[0]
            by = [
                f"{name.removeprefix('missed ')} by {nearest[name]:.4g}"
                for name in missed
                if nearest[name] > 0 or len(missed) == 1  # a strict limit may be missed by 0
            ]
            text += f"; the nearest misses {', '.join(by)}" if by else ""
        raise NothingFeasible(text, self.nearest)

    def __getitem__(self, name: str) -> Any:
        return self.found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(map(str, self.found.index))

    def __len__(self) -> int:
        """Return the number of columns; 0, which is false, if no point meets every budget."""
        return 0 if self.row is None else len(self.row)

    @property
    def shown(self) -> dict[str, Any]:
        """The columns that tell the design, what it is good at, and what was asked for."""
        import pandas

        row = self.found
        axes = [x for x in map(str, row.index) if "." in x and x != "model.kind" and pandas.notna(row[x])]
        design = [name for name in map(str, row.index) if name in _IDENTITY or name in axes]
        numbers = measured(row.to_frame().T, [name for name, _ in self.goals])
        return {name: row[name] for name in dict.fromkeys([*numbers, *design, *_OPTIONAL]) if name in row}

    def __repr__(self) -> str:
        if self.row is None:
            return f"<Choice: {self.notes[0]}; {len(self.nearest)} nearest>"
        numbers = [f"{name} {self.row[name]:.4g}" for name, _ in self.goals if name in self.row]
        on = f" on {self.row['hardware']}" if "hardware" in self.row else ""
        which = f"trial {self.row['trial']} of " if "trial" in self.row else ""
        return f"<Choice {which}{self.results.name}{on}: {', '.join(numbers)}>"

    def _repr_html_(self) -> str:
        """Return a small table for notebooks."""
        import pandas

        table = self.nearest if self.row is None else pandas.Series(self.shown, dtype=object).to_frame("")
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        return f"<p>{html.escape(repr(self))}</p>{table.to_html(border=0, na_rep='-')}{notes}"

    def export(
        self,
        folder: str | Path,
        targets: Sequence[str] = (),
        recordings: str | Path | None = None,
        refit: Sequence[str] = (),
        force: bool = False,
    ) -> Bundle:
        """Write the design point as a bundle; arguments as of `dse.export`, errors also those of `bundle`."""
        from dse.deploy.export import export

        return export(self._study(), self, folder, list(targets) or self.targets, recordings, refit, force)

    def bundle(self, refit: Sequence[str] = ()) -> Bundle:
        """Return the design point as a bundle, `refit` as of `dse.export`; nothing is written.

        Raises:
            StoreError: it is of a table.
            BundleError: its classifier cannot be deployed.
            NothingFeasible: there is none.
        """
        from dse.deploy.export import bundle_of

        return bundle_of(self._study(), self, refit)

    def _study(self) -> Study:
        """Return the study that has the network."""
        if not self.results.is_dir():
            raise StoreError(f"{self.results}: only a design of a study's folder can be exported")
        return open_study(self.results)


def choose(
    results: str | Path,
    budgets: Sequence[str] = (),
    maximise: str | None = None,
    question: Question = Question(),  # noqa: B008 (frozen)
) -> Choice:
    """Return the best design point of a study, or of a table, within budgets.

    Args:
        results: folder of a study, or a CSV, Parquet or JSON table.
        budgets: conditions such as "energy_uj <= 50 and n_weights <= 150000".
        maximise: column to maximise; None: the first objective that is maximised, or accuracy.
        question: what else is asked; its conditions count as budgets. Without `targets`, those of the study.

    Raises:
        ExpressionError: an unknown column, or a budget that cannot be read.
        StoreError: the study is damaged.
        BundleError: a target is unknown.
    """
    if question.by:
        raise ExpressionError("by must be absent from a pick, which is one design")
    budgets = [*question.where, *budgets]
    folder, oversize, draws = Path(results), question.oversize, question.draws or DRAWS
    study = open_study(folder) if folder.is_dir() else None
    if question.targets and study is None:
        raise StoreError(f"{results}: only designs of a study's folder have targets")
    [points] = question.points([results])
    targets = list(question.targets or (study.space.get("targets", ()) if study else ()))
    remarks = held.remarks(folder)
    if study and targets:
        from dse.deploy.footprints import on_targets

        points, on_target = on_targets(study, points, targets, question.hardware)
        remarks += on_target
    objectives = question.goals(folder) if study or question.objectives else []
    maximise = maximise or next((name for name, way in objectives if way == "max"), "accuracy")
    ties = [goal for goal in objectives if goal.column != maximise and goal.column in points]
    goals = [Goal(maximise, "max"), *ties]
    if question.confidence is None:
        picked = pick(points, budgets, maximise, ties, oversize=oversize)
    else:
        limited = budgeted(budgets)
        drawing = resampling.draws([results], [points], question.hardware, goals, draws, limited)
        picked = sure_pick(points, budgets, maximise, ties, drawing, question.confidence, oversize=oversize)
    if picked.row is None:
        sure = "" if question.confidence is None else f" in {question.confidence:.0%} of the samples"
        meets = f"no design point meets {' and '.join(budgets) or 'every condition'}{sure}"
        notes = [meets, *picked.notes, *remarks, *_misfit(study, picked.nearest, question.hardware)]
        return Choice(None, picked.nearest, notes, goals, targets, folder)
    row = picked.row.copy()
    # Accuracies on different tasks cannot be compared, nor can energies on different hardware.
    notes = [
        *picked.notes,
        *remarks,
        *(f"trial {row['trial']} leaves 24 bits: {text}" for text in [health.overflow(row)] if text),
        *corrected.lacking(row.to_frame().T, [name for name, _ in goals]),
        *_others(points, budgets, "task", "tasks"),
        *_others(points, budgets, "hardware", "hardware profiles"),
        *_others(points, budgets, "target", "targets"),
    ]
    return Choice(row, picked.nearest, notes, goals, targets, folder, question, budgets)


def _misfit(study: Study | None, nearest: pandas.DataFrame, hardware: Sequence[str]) -> list[str]:
    """Return why the nearest point does not fit its hardware, if it does not and its run can tell."""
    import pandas

    if study is None or nearest.empty or "fits" not in nearest:
        return []
    row = nearest.iloc[0]
    if pandas.isna(row["fits"]) or row["fits"] or not runs_of(study.folder, int(row["trial"])):
        return []
    why = "; ".join(pricing.misfits(study.folder, row, hardware))
    return [f"trial {row['trial']} does not fit {row['hardware']}: {why}"]


def _others(points: pandas.DataFrame, budgets: Sequence[str], column: str, plural: str) -> list[str]:
    """Return a hint if the pick compared rows that differ in a column whose values cannot be compared."""
    values = list(dict.fromkeys(map(str, points[column]))) if column in points else []
    if len(values) < 2 or column in named_columns(budgets):
        return []
    return [
        f"this is the best over the {plural} {', '.join(values)}; restrict it to one with "
        f"--budget \"{column} == '{values[0]}'\""
    ]
