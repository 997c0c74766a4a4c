"""Published systems, by their letters: printed numbers as rows beside designs of ours, and as marks.

Each function walks studies of one task on the same recordings and yields both. Designs are selected on
validation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.measure.objectives.accuracy import seeds_se
from dse.show.report import Mark
from dse.show.report.designs import StudyTask, best, sections_of
from dse.show.report.rows import Row, measured, number
from dse.store import StoreError
from dse_papers.report.correlation import spearman
from dse_papers.report.ends import front_ends
from dse_papers.report.facts import of_movement
from dse_papers.report.papers import publication, publication_of, systems

if TYPE_CHECKING:
    import pandas

Items = Iterator[Row | Mark]

_TIMES = {"t_p_ms": ("phi_p", "theta_p"), "t_h_ms": ("phi_h", "theta_h")}
_PLATFORM = "Loihi 2"
_TEXTURES = ("artificial", "natural")
# The printed S leaves the input out and is a sum over the test set; its mean on validation selects designs.
_FIGURES = {"accuracy": "accuracy", "spikes": "spikes_total_no_input", "n_weights": "n_weights"}
_TITLES = {**_FIGURES, "spikes": "spikes_total_no_input (printed S)"}
_CHOICE = "spikes_per_inference_no_input"
_TASKS = {"D": "texture", "E": "movement"}
_PEAK = ("hidden", "true_rate")

Chosen = tuple[StudyTask, "pandas.Series[Any]"]
"""A design, with its study."""


def rows_of(parts: Sequence[StudyTask]) -> tuple[list[Row], list[str]]:
    """Return the rows of every system beside some studies, in the order of the systems, and sentences."""
    rows = [x for x in _items(parts) if isinstance(x, Row)]
    shown = {row.system for row in rows}
    if "A" in shown:
        rows += _power()
    order = list(systems())
    rows.sort(key=lambda row: order.index(row.system))  # stable: studies and tasks stay together
    notes = []
    if rows:
        notes.append(
            "`published` is what a paper prints of its own recordings: shown for comparison, not reproduced"
        )
    if any(of_movement(part) for part in parts):
        notes.append(
            "published figures are for textures, those of E for velocity profiles, independent of our task"
        )
    silent = [f"{x} ({' or '.join(system.families)})" for x, system in systems().items() if x not in shown]
    return rows, [*notes, *([f"no designs for these systems: {', '.join(silent)}"] if silent else [])]


def marks_of(parts: Sequence[StudyTask]) -> list[Mark]:
    """Return the published designs whose numbers are in these rows, each once per task."""
    marks: dict[tuple[str, str], Mark] = {}
    for mark in (x for x in _items(parts) if isinstance(x, Mark)):
        marks.setdefault((mark.task, mark.name), mark)
    return sorted(marks.values(), key=lambda mark: mark.name[0])


def _items(parts: Sequence[StudyTask]) -> Items:
    walks: tuple[Callable[[Sequence[StudyTask]], Items], ...]
    walks = (_decision_maker, _rate_windows, _hots, _texture_velocity, _threshold, _receptors)
    alike: dict[tuple[str, str], list[StudyTask]] = {}  # of one task on the same recordings
    for part in parts:
        alike.setdefault((part.data, part.task), []).append(part)
    for group in alike.values():
        for walk in walks:
            yield from walk(group)


def _mark(system: str, part: StudyTask, which: str, values: Mapping[str, float], more: str = "") -> Mark:
    """Return the mark of one design of a system.

    Args:
        system: letter of the system.
        part: the task that it is compared with.
        which: the design; '' if the system has only one.
        values: published numbers by column.
        more: a further remark.
    """
    paper = publication_of(system)
    title = ", ".join(filter(None, [systems()[system].title, which]))
    other = "for textures, not for movements" if of_movement(part) and system != "E" else ""
    about = [f"on recordings that {paper.recordings}; not reproduced here", other, more]
    caption = f"{title}: published ({paper.source}), {'; '.join(filter(None, about))}"
    return Mark(", ".join(filter(None, [system, which])), part.task, values, paper.source, caption)


def _decision_maker(parts: Sequence[StudyTask]) -> Items:
    """Yield A: accuracy, t_p and t_h with their settings over the length of a sample.

    Nets of each trained length come first, then one net that is read out early. Networks for movements and
    joint ones are under D and E.
    """
    for part in parts:
        designs = part.of(systems()["A"].families)
        if designs.empty or of_movement(part) or part.joint:
            continue
        lengths, printed_ms = designs["decision_latency_ms"], _lengths_ms()
        for length in sorted(lengths.unique()):
            chosen = best(designs[lengths == length])
            if chosen is not None:
                # It stands beside the printed length that is as much of the longest.
                several = lengths.nunique() > 1
                beside_ms = length / lengths.max() * printed_ms[-1] if several else length
                yield from _of_length(part, chosen, length, int(np.abs(printed_ms - beside_ms).argmin()))
        longest = best(designs[lengths == lengths.max()])
        if longest is not None:
            yield from _early(part, longest, sorted(lengths.unique())[:-1])
            yield from _hardware(part, longest)


def _lengths_ms() -> np.ndarray:
    """Return the printed sample lengths."""
    return np.array([int(length) for length in publication_of("A").table("accuracy")])


def _power() -> Iterator[Row]:
    """Return the power of the paper's platforms."""
    printed = publication_of("A")
    for platform in printed.table("power_w"):
        numbers = "; ".join(f"{power:g}" for power in printed.table("power_w", platform).values())
        yield Row("A", f"power of {platform}, W: idle; beyond; in all", published=numbers)


def _of_length(part: StudyTask, chosen: pandas.Series[Any], length: float, at: int) -> Items:
    """Yield the figures of one trained length beside those of the printed length at a place."""
    printed_ms = str(_lengths_ms()[at])
    names = ("accuracy", *_TIMES, *(name for settings in _TIMES.values() for name in settings))
    printed = {name: publication_of("A").number(name, printed_ms) for name in names}
    values = {"accuracy": printed["accuracy"]}
    if "t_p_ms" in chosen.index:  # the mean time of a decision at these settings is t_p
        values |= {"decision_latency_ms": printed["t_p_ms"], "phi": printed["phi_p"]}
        values |= {"theta": printed["theta_p"], **{name: printed[name] for name in _TIMES}}
    if number(chosen.get("n_cores")) is not None:
        values["n_cores"] = publication_of("A").number("n_cores", _PLATFORM)
    yield _mark("A", part, f"samples of {printed_ms} ms", values)

    where = f"{length:g} ms (printed: {printed_ms} ms)"
    yield measured(part, "A", f"accuracy, {where}", printed["accuracy"], chosen)
    runs = part.arrays(int(chosen["trial"]), "read_out")
    last = {
        name: number(np.mean([run[name][-1] for run in runs]))
        for name in ("accuracy_best", *names)
        if name in runs[0]
    }
    if "accuracy_best" in last:
        peak = measured(part, "A", f"peak over phi and theta, {length:g} ms", printed["accuracy"], chosen)
        peak = replace(peak, ours=last["accuracy_best"], se=None, test=None)
        yield replace(peak, corrected=None, corrected_low=None, corrected_high=None)
    for time, settings in _TIMES.items():
        row = measured(part, "A", f"{time}, {where}", printed[time], chosen, time)
        if row.ours is None and time not in chosen.index:
            continue  # no decision grid
        yield row
        for name in settings:
            figure = f"{name}, {length:g} ms"
            yield replace(row, figure=figure, published=printed[name], ours=last.get(name), test=None)


def _early(part: StudyTask, row: pandas.Series[Any], lengths: Sequence[float]) -> Iterator[Row]:
    """Yield the accuracy of one network that is read out after shorter lengths than it was trained on."""
    if not lengths:
        return
    runs = part.arrays(int(row["trial"]), "read_out")
    times = runs[0]["decision_latency_ms"]
    if any(len(run["decision_latency_ms"]) != len(times) for run in runs):
        raise StoreError(f"{part.study.folder}: trial {row['trial']}: its runs have different read-outs")
    for k in dict.fromkeys(int(np.abs(times - length).argmin()) for length in lengths):
        for column in ("accuracy", *_TIMES):
            if column not in runs[0]:
                continue
            each = np.array([run[column][k] for run in runs])
            test = [run["accuracy_test"][k] for run in runs if "accuracy_test" in run]
            error = seeds_se(each) if len(each) > 1 else runs[0]["accuracy_se"][k]
            figure = f"{column}, longest net read out at {times[k]:g} ms"
            yield replace(
                measured(part, "A", figure, None, row, column),
                ours=number(each.mean()),
                se=number(error) if column == "accuracy" else None,
                test=number(np.mean(test)) if test and column == "accuracy" else None,
            )


def _hardware(part: StudyTask, row: pandas.Series[Any]) -> Iterator[Row]:
    printed = publication_of("A")
    if number(row.get("n_cores")) is not None:
        figure = f"n_cores, {row['hardware']} (printed: of {printed.number('cores_of_chip'):g})"
        yield measured(part, "A", figure, printed.number("n_cores", _PLATFORM), row, "n_cores")
    if "energy_uj" in row.index:
        yield measured(part, "A", f"energy_uj per inference, {row['hardware']}", None, row, "energy_uj")


def _rate_windows(parts: Sequence[StudyTask]) -> Items:
    """Yield B: accuracy and t_C of the best design of each classifier on rate windows."""
    for part in parts:
        for family in systems()["B"].families:
            if (chosen := best(part.of([family]))) is not None:
                columns = ("accuracy", "t_c_ms")
                yield from _on_textures("B", part, chosen, family, {x: (x, family) for x in columns})


def _hots(parts: Sequence[StudyTask]) -> Items:
    """Yield C: accuracy of HOTS by its number of layers."""
    for part in parts:
        designs = part.of(systems()["C"].families)
        layers = [int(getattr(part.model(int(trial)), "layers", 0)) for trial in designs["trial"]]
        for n in publication_of("C").table("hots_accuracy", _TEXTURES[0]):
            if (chosen := best(designs[np.array(layers, dtype=int) == int(n)])) is not None:
                which = f"{n} layer{'s' if int(n) > 1 else ''}"
                yield from _on_textures("C", part, chosen, which, {"accuracy": ("hots_accuracy", n)})


def _on_textures(
    system: str,
    part: StudyTask,
    chosen: pandas.Series[Any],
    which: str,
    printed: Mapping[str, tuple[str, str]],
) -> Items:
    """Yield a row per column, with the numbers for artificial and natural textures, and a mark of each.

    Args:
        system: letter.
        part: a study's designs.
        chosen: the design.
        which: what it is, in words.
        printed: column -> the printed result, and its condition beside the textures.
    """
    paper = publication_of(system)
    for textures in _TEXTURES:
        values = {column: paper.number(key, textures, by) for column, (key, by) in printed.items()}
        yield _mark(system, part, f"{which} on {textures} textures", values)
    for column, (key, by) in printed.items():
        artificial, natural = (paper.number(key, textures, by) for textures in _TEXTURES)
        text = f"{artificial:g}; natural {natural:g}"
        yield measured(part, system, f"{column}, {which}", text, chosen, column)


def _texture_velocity(parts: Sequence[StudyTask]) -> Items:
    """Yield D or E: ends of the front, rank correlations, and accuracy by kind of profile."""
    for part in parts:
        system = "E" if of_movement(part) else "D"
        families = systems()[system].families
        if best(part.of(families)) is not None:
            for end in publication_of(system).table("accuracy", _TASKS[system]):
                values = {column: _printed(system, figure, end) for figure, column in _FIGURES.items()}
                of_peak = " and ".join(f"{name} {_printed(system, name):g}" for name in _PEAK)
                spikes = "spikes are those of hidden and output neurons over the test set"
                more = f"{of_peak}; {spikes}" if end == "best accuracy" else spikes
                yield _mark(system, part, end, values, more)
        for family in families:
            peak = best(part.of([family]))
            if peak is not None:
                # Cascades and joint networks are marked as such.
                kind = f"{family}: " if family == "cascade" else "joint net: " if part.joint else ""
                yield from _of_family(part, system, part.of([family]), peak, kind)


def _printed(system: str, figure: str, *conditions: str) -> float:
    return publication_of(system).number(figure, _TASKS[system], *conditions)


def _of_family(
    part: StudyTask, system: str, designs: pandas.DataFrame, peak: pandas.Series[Any], kind: str
) -> Iterator[Row]:
    for end, index in front_ends(designs, _CHOICE).items():
        chosen = peak if end == "best accuracy" else designs.loc[index]
        for figure, column in _FIGURES.items():
            printed = _printed(system, figure, end)
            yield measured(part, system, f"{kind}{end}: {_TITLES[figure]}", printed, chosen, column)
        yield measured(part, system, f"{kind}{end}: {_CHOICE}", None, chosen, _CHOICE)
    model = part.model(int(peak["trial"]))
    for name in (name for name in _PEAK if hasattr(model, name)):
        base = measured(part, system, f"{kind}best accuracy: {name}", _printed(system, name), peak)
        yield replace(base, ours=number(np.sum(getattr(model, name))), se=None, test=None)
    for figure, printed in publication_of(system).table("spearman", _TASKS[system]).items():
        cost = _CHOICE if figure == "spikes" else _FIGURES[figure]
        rho = spearman(designs["accuracy"].to_numpy(float), designs[cost].to_numpy(float))
        text = f"{kind}Spearman of accuracy and {figure}, {len(designs)} designs"
        yield Row(system, text, part.task, printed, number(rho), split=part.split, study=part.name)
    if system == "E":
        yield from _groups(part, peak, kind)


def _groups(part: StudyTask, peak: pandas.Series[Any], kind: str) -> Iterator[Row]:
    """Yield the best network's accuracy on each kind of profile, where classes are named after them."""
    classes = part.classes(int(peak["trial"]))
    runs = part.arrays(int(peak["trial"]), "confusion")

    def right(matrix: np.ndarray, members: list[int]) -> float:
        """Return the share of samples of some classes that are answered right; NaN without samples."""
        total = matrix[members].sum()
        return float(matrix[members, members].sum() / total) if total else math.nan

    for group, printed in publication_of("E").table("groups", _TASKS["E"]).items():
        members = [k for k, name in enumerate(classes) if name.startswith(group)]
        ours = np.mean([right(run["validation"], members) for run in runs])
        tests = [right(run["test"], members) for run in runs if "test" in run]
        if members and np.isfinite(ours):
            base = measured(part, "E", f"{kind}best accuracy: {group} profiles", printed, peak)
            yield replace(base, ours=float(ours), se=None, test=number(np.mean(tests)) if tests else None)


def _threshold(parts: Sequence[StudyTask]) -> Items:
    """Yield F: threshold encoding as printed, which reads the label, and honest."""
    families, printed = systems()["F"].families, publication("003")
    leaky, honest = (_chosen(parts, families, transductive=is_leaky) for is_leaky in (True, False))
    low, high = sorted(printed.table("first_spike_ms").values())
    more = f"first spikes {low:g} to {high:g} ms"
    yield from _of_leak("F", printed.number("accuracy"), leaky, honest, more)
    for name, one in (("as printed (transductive)", leaky), ("honest", honest)):
        if one is not None:
            text = f"{low:g} to {high:g}" if one is leaky or leaky is None else None
            row = measured(one[0], "F", f"first_spike_ms, mean, {name}", text, one[1], "first_spike_ms")
            ends = [
                measured(one[0], "F", f"{column}, {name}", end, one[1], column)
                for column, end in (("first_spike_class_min_ms", low), ("first_spike_class_max_ms", high))
            ]
            yield from (x for x in (row, *ends) if x.ours is not None)


def _receptors(parts: Sequence[StudyTask]) -> Items:
    """Yield G: receptors and a time-delayed ELM; printed windows of one run are in training and in test."""
    families, printed = systems()["G"].families, publication("004")
    leaky = _chosen(parts, families, transductive=True, encoders=False)
    honest = _chosen(parts, families, transductive=False)
    yield from _of_leak("G", printed.number("accuracy"), leaky, honest)
    if honest is None:
        return
    part, row = honest
    for column in ("itr_bits", "itr_bits_per_s", "t_c_ms"):
        yield measured(part, "G", f"{column}, honest", None, row, column)
    base = replace(measured(part, "G", "", None, row), se=None, test=None)
    runs = part.arrays(int(row["trial"]), "read_out")
    accuracy = np.mean([run["accuracy"] for run in runs], axis=0)
    earliest = float(runs[0]["decision_latency_ms"][accuracy.argmax()])
    figure = "time of the highest accuracy, ms"
    yield replace(base, figure=figure, published=printed.number("recognition_ms"), ours=earliest)
    hidden = float(np.sum(getattr(part.model(int(row["trial"])), "hidden", 0)))
    yield replace(base, figure="hidden nodes", published=printed.number("hidden"), ours=hidden)


def _chosen(
    parts: Sequence[StudyTask], families: Sequence[str], *, transductive: bool, encoders: bool = True
) -> Chosen | None:
    """Return the best design of some families in several studies, with its study.

    Args:
        parts: studies of one task.
        families: kinds of models.
        transductive: whether the designs have seen the labels.
        encoders: whether to include designs whose encoder reads labels: another leak than that of a split.
    """
    import pandas

    several = [(part, part.of(families, transductive=transductive)) for part in parts]
    if not encoders:
        several = [
            (part, rows[[not sections_of(part.study.folder, int(x)).reads_labels for x in rows["trial"]]])
            for part, rows in several
            if not rows.empty
        ]
    tables = [rows.assign(place=place) for place, (_, rows) in enumerate(several) if not rows.empty]
    row = best(pandas.concat(tables, ignore_index=True)) if tables else None
    return None if row is None else (several[int(row["place"])][0], row.drop("place"))


def _of_leak(
    system: str, printed: float, leaky: Chosen | None, honest: Chosen | None, more: str = ""
) -> Items:
    """Yield the mark, accuracy as printed, honest accuracy, and their difference where both are known."""
    if (beside := leaky or honest) is None:
        return
    about = "; ".join(filter(None, ["transductive: it has seen the labels", more]))
    yield _mark(system, beside[0], "", {"accuracy": printed}, about)
    row = None if leaky is None else leaky[1]
    one = measured(beside[0], system, "accuracy, as printed (transductive)", printed, row)
    yield one
    if honest is None:
        return
    other = measured(honest[0], system, "accuracy, honest", None, honest[1])
    yield other
    if leaky is not None:
        assert one.ours is not None and other.ours is not None  # `best` returns finite accuracies
        se = None if one.se is None or other.se is None else math.hypot(one.se, other.se)
        figure = "size of the leak (as printed less honest)"
        leak = replace(other, figure=figure, ours=one.ours - other.ours, se=se, test=None)
        yield replace(leak, runs=None, trial=None, design="")
