"""Which recordings train, select, and test: by column, by stratified draw, or one group left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse import seeds
from dse.config.faults import known_names
from dse.recordings import RecordingError
from dse.records import Array
from dse.registry import param


@dataclass(frozen=True)
class Stratified:
    """A random draw of the same fraction of every class."""

    validation: float = param(
        doc="fraction of every class", low=0, low_open=True, high=1, high_open=True, axis=False
    )
    test: float = param(0.0, doc="fraction of every class", low=0, high=1, high_open=True, axis=False)
    seed: int = param(0, doc="seed of the draw", low=0, axis=False)


@dataclass(frozen=True)
class LeaveOut:
    """One group validates, the rest trains."""

    column: str = param(doc="label column of the groups", axis=False)
    value: Any = param(doc="the group left out", axis=False)  # noqa: RUF009


@dataclass(frozen=True)
class Split:
    """One of three: `train` and `validation` (and `test`) by column values, `stratified`, or `leave_out`."""

    train: Mapping[str, Any] | None = param(
        None, doc="column -> value or values of training recordings", axis=False
    )
    validation: Mapping[str, Any] | None = param(
        None, doc="column -> value or values that validate", axis=False
    )
    test: Mapping[str, Any] | None = param(
        None, doc="column -> value or values of test recordings", axis=False
    )
    stratified: Stratified | None = param(  # noqa: RUF009
        None, doc="the same fraction of every class, drawn", axis=False
    )
    leave_out: LeaveOut | None = param(  # noqa: RUF009
        None, doc="one group validates, the rest trains", axis=False
    )

    def __post_init__(self) -> None:
        by_column = self.train is not None or self.validation is not None or self.test is not None
        if by_column + (self.stratified is not None) + (self.leave_out is not None) != 1:
            raise RecordingError(
                "split must be one of: train and validation by column, stratified, leave_out"
            )
        if by_column and not (self.train and self.validation):
            raise RecordingError("split must name columns for both train and validation")

    def columns(self) -> tuple[str, ...]:
        """Return the label columns that the split reads."""
        named = [*(self.train or {}), *(self.validation or {}), *(self.test or {})]
        return tuple(dict.fromkeys(named + ([] if self.leave_out is None else [self.leave_out.column])))


def split(
    columns: Mapping[str, Array], codes: Array, classes: tuple[str, ...], settings: Split
) -> tuple[Array, Array, Array]:
    """Return the train, validation and test recordings: rising int64 indices, disjoint.

    Args:
        columns: label columns, each (n,).
        codes: (n,) target of every recording, into `classes`.
        classes: names of the classes.
        settings: how to split.

    Raises:
        RecordingError: unknown column or value, parts that overlap or are empty, a class that is too
            small to divide or is missing from train.
    """
    masks = dict(zip(("train", "validation", "test"), _masks(columns, codes, classes, settings), strict=True))
    several = sum(mask.astype(int) for mask in masks.values()) > 1
    if np.any(several):
        both = [name for name, mask in masks.items() if mask[np.argmax(several)]]
        raise RecordingError(f"split: recording {np.argmax(several)} is in {' and in '.join(both)}")
    for name in ("train", "validation"):
        if not masks[name].any():
            raise RecordingError(f"split.{name} holds no recording")
    for name in ("validation", "test"):
        for code in np.setdiff1d(codes[masks[name]], codes[masks["train"]]):
            raise RecordingError(f"split: class '{classes[code]}' is in {name} but missing from train")
    train, validation, test = (np.flatnonzero(mask).astype(np.int64) for mask in masks.values())
    return train, validation, test


def _masks(
    columns: Mapping[str, Array], codes: Array, classes: tuple[str, ...], settings: Split
) -> Iterator[Array]:
    if settings.stratified is not None:
        part = _drawn(codes, classes, settings.stratified)
        yield from (part == 0, part == 1, part == 2)
    elif settings.leave_out is not None:
        out = settings.leave_out
        held = _chosen(columns, {out.column: out.value}, "leave_out")
        yield from (~held, held, np.zeros_like(held))
    else:
        for name in ("train", "validation", "test"):
            yield _chosen(columns, getattr(settings, name), name)


def _chosen(columns: Mapping[str, Array], wanted: Mapping[str, Any] | None, name: str) -> Array:
    n = len(next(iter(columns.values()), ()))
    mask = np.full(n, bool(wanted))
    for column, values in (wanted or {}).items():
        if column not in columns:
            raise RecordingError(
                f"split.{name}: no column '{column}' among data.columns; {known_names(column, columns)}"
            )
        labels = columns[column]
        known = np.unique(labels).tolist()
        hit = np.zeros(n, dtype=bool)
        for value in values if isinstance(values, list | tuple) else (values,):
            value = str(value) if labels.dtype.kind == "U" else value
            if value not in known:
                raise RecordingError(
                    f"split.{name}: column '{column}' holds no {value!r}; it holds {_some(known)}"
                )
            hit |= labels == value
        mask &= hit
    return mask


def _some(values: list[Any]) -> str:
    return ", ".join(map(str, values[:10])) + (", ..." if len(values) > 10 else "")


def _drawn(codes: Array, classes: tuple[str, ...], settings: Stratified) -> Array:
    """Return 0 (train), 1 (validation) or 2 (test) for every recording."""
    part = np.zeros(len(codes), dtype=np.int64)
    for code in np.unique(codes):
        # A generator per class: adding recordings of one class leaves the draw of the others as it was.
        members = seeds.generator(settings.seed, {}, "split", int(code)).permutation(
            np.flatnonzero(codes == code)
        )
        n_validation, n_test = round(settings.validation * len(members)), round(settings.test * len(members))
        if not n_validation or (settings.test and not n_test) or n_validation + n_test >= len(members):
            raise RecordingError(
                f"split.stratified: class '{classes[code]}' has {len(members)} recordings, too few for "
                f"validation {settings.validation:g} and test {settings.test:g}"
            )
        part[members[:n_validation]] = 1
        part[members[n_validation : n_validation + n_test]] = 2
    return part
