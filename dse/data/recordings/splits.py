"""The split into training, validation and test recordings, and groups that training leaves out in turn."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dse.base import seeds
from dse.base.records import Array, Bools, Head, Ints
from dse.config.faults import known_names
from dse.config.resolved import LeftOut
from dse.config.settings import CUT_COLUMNS, Groups, KFold, Split, Stratified, Task, Window
from dse.config.yaml_lines import Raw
from dse.data.recordings import RecordingError
from dse.data.recordings.targets import heads, in_use, target

ORIGINAL, NUMBER = CUT_COLUMNS
"""Columns of windows that were cut: the number of the recording that each is from, and its own within it."""


_NAMES = ("train", "validation", "test")


def split(
    columns: Mapping[str, Array], codes: Ints, classes: tuple[str, ...], settings: Split
) -> tuple[Ints, Ints, Ints]:
    """Return the train, validation and test recordings: rising int64 indices, disjoint.

    columns: label columns, each (n,). codes: (n,) target of every recording, into `classes`.

    Raises:
        RecordingError: unknown column or value, parts that overlap or are empty, a class that is too
            small to divide or is missing from train, a group in two parts.
    """
    of = _ToSplit(columns, codes, classes)
    if settings.stratified is not None:
        part = of.drawn(settings.stratified)
    elif settings.k_fold is not None:
        part = of.folded(settings.k_fold)
    elif settings.leave_out is not None:
        out = settings.leave_out
        part = of.chosen({out.column: out.value}, "leave_out").astype(np.int64)
    else:
        masks = np.array([of.chosen(getattr(settings, name), name) for name in _NAMES])
        several = masks.sum(axis=0) > 1
        if np.any(several):
            both = [name for name, mask in zip(_NAMES, masks, strict=True) if mask[np.argmax(several)]]
            raise RecordingError(f"split: recording {np.argmax(several)} is in {' and in '.join(both)}")
        part = np.where(masks.any(axis=0), masks.argmax(axis=0), -1)
    train, validation, test = (np.flatnonzero(part == k).astype(np.int64) for k in range(len(_NAMES)))
    for name, members in (("train", train), ("validation", validation)):
        if not len(members):
            raise RecordingError(f"split.{name} selects no recording")
    for name, members in (("validation", validation), ("test", test)):
        for code in np.setdiff1d(codes[members], codes[train]):
            raise RecordingError(f"split: class '{classes[code]}' is in {name} but missing from train")
    return train, validation, test


@dataclass(frozen=True)
class _ToSplit:
    """Recordings to split: label columns, each (n,), codes (n,) of the target and the names of its classes.

    A part is 0 (train), 1 (validation) or 2 (test).
    """

    columns: Mapping[str, Array]
    codes: Ints
    classes: tuple[str, ...]

    def chosen(self, conditions: Mapping[str, Raw] | None, name: str) -> Bools:
        """Return the recordings, (n,) bool, with the label values that a part or key of the split names."""
        mask = np.full(len(self.codes), bool(conditions))
        for column, values in (conditions or {}).items():
            labels = self._column(column, name)
            known = np.unique(labels).tolist()
            matches = np.zeros(len(labels), dtype=bool)
            for value in values if isinstance(values, list | tuple) else (values,):
                value = str(value) if labels.dtype.kind == "U" else value
                if value not in known:
                    some = ", ".join(map(str, known[:10])) + ", ..." * (len(known) > 10)
                    raise RecordingError(
                        f"split.{name}: column '{column}' has no value {value!r}; its values are {some}"
                    )
                matches |= labels == value
            mask &= matches
        return mask

    def _column(self, column: str, name: str) -> Array:
        if column not in self.columns:
            known = known_names(column, self.columns)
            raise RecordingError(f"split.{name}: no column '{column}' among data.columns; {known}")
        return self.columns[column]

    def drawn(self, settings: Stratified) -> Ints:
        """Return the part of every recording, (n,)."""
        where = "stratified"
        given, groups = self._given_test(settings, where)
        test = 0.0 if isinstance(settings.test, Mapping) else settings.test
        sizes = f"validation {settings.validation:g} and test {test:g}"
        part = np.where(given, 2, 0)
        if settings.group is not None:
            shares = [1 - settings.validation - test, settings.validation, test]
            if shares[0] <= 0:
                raise RecordingError(f"split.{where} must leave recordings for training, got {sizes}")
            shares = [share for share in shares if share > 0]
            rest = np.flatnonzero(~given)
            self._check_enough(rest, groups, len(shares), where, settings.group, sizes)
            rng = seeds.generator(settings.seed, {}, "split")
            part[rest] = dealt(self.codes[rest], groups[rest], shares, rng)
            return part
        for code in np.unique(self.codes[~given]):
            # A generator per class: adding recordings of one class leaves the draw of the others as it was.
            members = seeds.generator(settings.seed, {}, "split", int(code)).permutation(
                np.flatnonzero((self.codes == code) & ~given)
            )
            n_validation, n_test = round(settings.validation * len(members)), round(test * len(members))
            if not n_validation or (test and not n_test) or n_validation + n_test >= len(members):
                raise self._too_few(where, code, f"{len(members)} recordings", sizes)
            part[members[:n_validation]] = 1
            part[members[n_validation : n_validation + n_test]] = 2
        return part

    def folded(self, settings: KFold) -> Ints:
        """Return the part of every recording, (n,), in one fold."""
        where, k, codes = "k_fold", settings.k, self.codes
        test, groups = self._given_test(settings, where)
        if settings.test is not None and not isinstance(settings.test, Mapping):
            sizes = f"test {settings.test:g}"
            self._check_enough(np.arange(len(codes)), groups, 2, where, settings.group, sizes)
            shares = [1 - settings.test, settings.test]
            test = dealt(codes, groups, shares, seeds.generator(settings.seed, {}, "test")) == 1
            for code in np.setdiff1d(codes, codes[test]):
                raise RecordingError(
                    f"split.{where}: class '{self.classes[code]}' has too few recordings for {sizes}"
                )
        rest = np.flatnonzero(~test)
        self._check_enough(rest, groups, k, where, settings.group, f"k = {k}")
        part = np.where(test, 2, 0)
        rng = seeds.generator(settings.seed, {}, "folds")
        part[rest] = dealt(codes[rest], groups[rest], [1 / k] * k, rng) == settings.fold
        for code in np.setdiff1d(codes[rest], codes[part == 0]):
            raise RecordingError(
                f"split.{where}: class '{self.classes[code]}' is missing from train in fold {settings.fold} "
                f"of {k}: all its recordings validate there"
            )
        return part

    def _given_test(self, settings: Stratified | KFold, where: str) -> tuple[Bools, Ints]:
        """Return the recordings that label values put into the test set, (n,) bool, and each one's group."""
        groups, given = np.arange(len(self.codes)), np.zeros(len(self.codes), dtype=bool)
        if settings.group is not None:
            column = self._column(settings.group, f"{where}.group")
            groups = np.unique(column, return_inverse=True)[1]
        if isinstance(settings.test, Mapping):
            given = self.chosen(settings.test, f"{where}.test")
            torn = np.intersect1d(groups[given], groups[~given])
            if len(torn):
                value = self.columns[str(settings.group)][groups == torn[0]][0]
                raise RecordingError(
                    f"split.{where}: group '{value}' is both in the test set and outside of it"
                )
        return given, groups

    def _check_enough(
        self, rest: Ints, groups: Ints, n_parts: int, where: str, column: str | None, sizes: str
    ) -> None:
        """Raise where a class has fewer groups (or recordings) than there are parts."""
        what = "recordings" if column is None else f"groups of column '{column}'"
        for code in np.unique(self.codes[rest]):
            n = len(np.unique(groups[rest][self.codes[rest] == code]))
            if n < n_parts:
                raise self._too_few(where, code, f"{n} {what}", sizes)

    def _too_few(self, where: str, code: int, has: str, sizes: str) -> RecordingError:
        return RecordingError(f"split.{where}: class '{self.classes[code]}' has {has}, too few for {sizes}")


def dealt(codes: Ints, groups: Ints, shares: Sequence[float], rng: np.random.Generator) -> Ints:
    """Return the part of every recording (n,): groups stay whole, classes are divided by shares.

    Groups go one by one, the largest first, equal ones in drawn order, to the part where they leave the
    smallest sum over parts p and classes c of (n_pc / N_c - share_p)^2, n_pc of the N_c recordings of a
    class lying in p; that is where they find most of their classes lacking. Equal parts: the one with fewest
    recordings for its share, then the first. Greedy: near the best division, not always the best.

    codes, groups: (n,) class and group of every recording. shares: of the parts, > 0, sum 1.
    """
    _, group = np.unique(groups, return_inverse=True)
    _, label = np.unique(codes, return_inverse=True)
    members = np.zeros((group.max(initial=-1) + 1, label.max(initial=-1) + 1))
    np.add.at(members, (group, label), 1)
    sizes = members.sum(axis=1)
    fractions = members / members.sum(axis=0)
    quota = np.asarray(shares, dtype=np.float64)
    filled = np.zeros((len(quota), members.shape[1]))
    load = np.zeros(len(quota))
    part = np.zeros(len(members), dtype=np.int64)
    order = rng.permutation(len(members))
    for number in order[np.argsort(-sizes[order], kind="stable")]:
        # Rounded: parts that are equal but for the last bits of a sum are equal.
        surplus = np.round((filled - quota[:, None]) @ fractions[number], 12)
        best = int(np.lexsort((load / quota, surplus))[0])
        part[number] = best
        filled[best] += fractions[number]
        load[best] += sizes[number]
    return part[group]


def shared_reach(window: Window) -> int:
    """Return how far the numbers of windows of one recording may differ that have steps in common."""
    return ((window.cut_steps or 1) - 1) // (window.every_steps or window.cut_steps or 1)


@dataclass(frozen=True)
class Labelled:
    """Recordings as they are labelled and split.

    columns: label columns, each (n,).
    task: what is predicted.
    classes: names of the classes that recordings of some part have.
    codes: (n,) class of every recording; -1 where it is none of these.
    train, validation, test: recordings of each part, rising.
    """

    columns: Mapping[str, Array]
    task: Task
    codes: Ints
    classes: tuple[str, ...]
    train: Ints
    validation: Ints
    test: Ints

    @classmethod
    def of(
        cls, columns: Mapping[str, Array], task: Task, settings: Split, only: Ints | None = None
    ) -> Labelled:
        """Return the labels of recordings; `only`: those that the parts are limited to, None: all."""
        codes, classes = target(columns, task.target)
        parts = split(columns, codes, classes, settings)
        if only is not None:
            train, validation, test = (part[np.isin(part, only)] for part in parts)
            parts = train, validation, test
        used = np.isin(np.arange(len(codes)), np.concatenate(parts))
        return cls(columns, task, *in_use(codes, classes, used), *parts)

    @functools.cached_property
    def used(self) -> Bools:
        """Which recordings are in some part, (n,)."""
        parts = np.concatenate([self.train, self.validation, self.test])
        return np.asarray(np.isin(np.arange(len(self.codes)), parts))

    @functools.cached_property
    def heads(self) -> tuple[Head, ...]:
        """The parts of a joint target; none of another."""
        return heads(self.columns, self.task.target, self.codes) if self.task.joint else ()


def leak(of: Labelled, settings: Split, window: Window) -> str:
    """Return a sentence if windows in two parts share steps of one recording, else nothing.

    A model answers steps that it was trained on from memory. Windows of one recording that share no step are
    separate samples. Columns `recording` and `window` say what a window was cut from (`windows.cut`).
    """
    if window.cut_steps is None:
        return ""
    reach = shared_reach(window)
    # One number per window, so that windows share steps where numbers are at most `reach` apart.
    number = of.columns[ORIGINAL] * (of.columns[NUMBER].max(initial=0) + reach + 1) + of.columns[NUMBER]
    parts = {name: getattr(of, name) for name in _NAMES}
    for one, other in itertools.combinations(parts, 2):
        known, queried = np.sort(number[parts[one]]), number[parts[other]]
        at = np.searchsorted(known, queried - reach)
        near = np.append(known, np.iinfo(np.int64).max)[at] <= queried + reach
        if reach and near.any():
            drawn = next((name for name in ("stratified", "k_fold") if getattr(settings, name)), "")
            remedy = f"split.{drawn}.group: {ORIGINAL}" if drawn else f"a split by column '{ORIGINAL}'"
            return (
                f"windows with common steps of one recording are in {one} and in {other} ({near.sum()} of "
                f"the {len(queried)} in {other}), which can be answered from memory; {remedy} prevents this"
            )
    return ""


def folds(
    columns: Mapping[str, Array], groups: Groups, codes: Ints, train: Ints, validation: Ints
) -> list[LeftOut]:
    """Return the folds of a label column, each with values of its own, in the order of their first values.

    The values are those of validation recordings. Folds of several values have near equal shares of every
    class of the validation recordings (`splits.dealt`); they follow from the seed and the labels.
    columns, codes: (n,) of every recording. train, validation: indices.

    Raises:
        RecordingError: an unknown column, or fewer values than folds.
    """
    name = groups.column
    if name not in columns:
        raise RecordingError(
            f"evaluation.leave_out: no column '{name}' among data.columns; {known_names(name, columns)}"
        )
    labels = columns[name][validation]
    values, number = np.unique(labels, return_inverse=True)
    n = groups.folds or max(2, len(values))
    if len(values) < n:
        raise RecordingError(
            f"evaluation.leave_out: column '{name}' must have at least {n} values in validation, "
            f"got {len(values)}"
        )
    fold = np.arange(len(values))
    if groups.folds is not None:
        rng = seeds.generator(groups.seed, {}, f"left out {name}")
        fold[number] = dealt(codes[validation], number, [1 / n] * n, rng)
    members = [tuple(values[fold == k].tolist()) for k in np.unique(fold)]
    return [LeftOut(name, x) for x in sorted(members)]


def without(
    columns: Mapping[str, Array], left_out: LeftOut, train: Ints, validation: Ints
) -> tuple[Ints, Ints, Ints]:
    """Return the training and validation recordings outside a fold, and the validation recordings in it."""
    values = columns[left_out.column]
    held = np.isin(values, np.asarray(left_out.values, values.dtype))
    return train[~held[train]], validation[~held[validation]], validation[held[validation]]


def in_turn(of: Labelled, groups: Sequence[Groups]) -> tuple[list[LeftOut], list[str]]:
    """Return the folds of label columns, and a sentence for each whose absence leaves a class untrained."""
    out = [x for column in groups for x in folds(of.columns, column, of.codes, of.train, of.validation)]
    faults = []
    for one in out:
        rest, _, _ = without(of.columns, one, of.train, of.validation)
        if lacking := [f"'{of.classes[code]}'" for code in np.setdiff1d(of.codes[of.train], of.codes[rest])]:
            faults.append(
                f"evaluation.leave_out: without {one.column} {one.name} there is no training recording of "
                f"class {', '.join(lacking)}"
            )
    return out, faults
