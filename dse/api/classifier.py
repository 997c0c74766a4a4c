"""A study as a scikit-learn estimator: search, pick and bundle behind fit and predict."""

from __future__ import annotations

import json
import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import assert_all_finite
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, column_or_1d, validate_data

from dse.api.first import init
from dse.api.study import run
from dse.config import ConfigError, load_space
from dse.data.given import from_arrays
from dse.data.recordings import RecordingError
from dse.deploy.export import written
from dse.deploy.predict import predicted
from dse.store import StoreError

if TYPE_CHECKING:
    from dse.base.records import Array, Floats
    from dse.deploy.bundle import Bundle


class Classifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc] # scikit-learn has no types
    """What `dse.init`, `dse.run` and a pick make of arrays, as scikit-learn uses it.

    `fit` holds recordings back for validation, and for a test, by itself; then the pick learns from all of
    them. It keeps `study_` (the study), `pick_` (the design, with what it measured), `bundle_` (its
    classifier) and `classes_`.

    Args:
        budget: conditions that the pick meets, such as "energy_uj <= 50", one or several.
        chip: hardware profile that energy and latency are computed for; None: the usual one.
        task: name of the label: the column of `y` that is predicted where it is a table.
        step_ms: sampling period.
        axes: order of the axes of X; 'recording step channel' is the other one. Lists of recordings of
            unequal length have no axis `recording`.
        minutes: that a fit may take; None: as long as the search does.
        settings: other values of the search space, dotted key -> value: {"training.epochs": 20}.
        results: folder that the study is kept in; None: a temporary one, which goes with the estimator.
        n_jobs: worker processes.
        random_state: seed of the study.

    >>> rng = np.random.default_rng(1)
    >>> y = np.tile(["denim", "silk"], 10)
    >>> turn = np.where(y == "denim", 0.1, 0.6)[:, None, None] * np.arange(50)
    >>> X = np.sin(turn + rng.normal(size=(20, 2, 1)))
    >>> small = {"model": {"kind": "snn", "hidden": 5}, "training.epochs": 20}
    >>> classifier = dse.Classifier(budget="n_weights <= 100", chip="mcu_m4", settings=small)
    >>> classifier.fit(X, y).score(X, y) > 0.8
    True
    """

    def __init__(
        self,
        *,
        budget: str | Sequence[str] = (),
        chip: str | None = None,
        task: str = "label",
        step_ms: float = 10.0,
        axes: str = "recording channel step",
        minutes: float | None = None,
        settings: Mapping[str, Any] | None = None,
        results: str | Path | None = None,
        n_jobs: int = 1,
        random_state: int = 1,
    ) -> None:
        self.budget = budget
        self.chip = chip
        self.task = task
        self.step_ms = step_ms
        self.axes = axes
        self.minutes = minutes
        self.settings = settings
        self.results = results
        self.n_jobs = n_jobs
        self.random_state = random_state

    def fit(self, X: Any, y: Any, groups: Any = None) -> Self:
        """Search for a classifier of recordings, and pick the best within the budget.

        Args:
            X: (recording, channel, step), (recording, step) of one channel, or a list of recordings of
                unequal length, (channel, step) each; windows then are as long as the shortest. Also tables:
                a row per recording, whose cells are samples, or arrays of a channel each.
            y: (recording,) classes, or a table with the column `task`.
            groups: (recording,) sessions, persons or the like, which stay in one part of the split.

        Raises:
            ValueError: recordings, labels or groups that no study can be made of, settings of no search
                space, or a budget that no design meets; one line each.
        """
        X = self._signals(X, reset=True)
        labels = y[self.task] if getattr(y, "ndim", 1) == 2 and hasattr(y, "columns") else y
        if labels is None:
            raise ValueError("fit requires y to be passed, but the target y is None")
        labels = column_or_1d(labels, warn=True)
        assert_all_finite(labels, input_name="y")
        check_classification_targets(labels)
        if len(labels) != len(X):
            raise ValueError(f"y must have a label for each of the {len(X)} recordings, got {len(labels)}")
        self.classes_ = np.unique(labels)
        columns = {self.task: labels.astype(str)}
        if groups is not None:
            columns["group"] = column_or_1d(groups).astype(str)
        folder = Path(self.results) if self.results is not None else Path(tempfile.mkdtemp(prefix="dse-"))
        if self.results is None:
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        try:
            data = from_arrays(
                X, columns, step_ms=self.step_ms, axes=self._axes(X), file=folder / "recordings.npz"
            )
            space = init(
                data,
                folder / "study.yaml",
                label=self.task,
                group=None if groups is None else "group",
                force=True,
            )
            loaded = load_space(space, self._overrides())
            self.study_ = run(loaded, folder, jobs=self.n_jobs, progress=False)
        except (ConfigError, StoreError) as error:
            raise ValueError(str(error)) from error
        self.pick_ = self.study_.pick(self.budget)
        self.bundle_: Bundle = self.pick_.bundle(("train", "validation", "test"))
        return self

    def predict(self, X: Any) -> Array:
        """Return the class of each recording, (recording,).

        Raises:
            ValueError: recordings of other channels, or shorter than the windows of the fit.
        """
        label, _ = self._predicted(X)
        return np.asarray(self.classes_[self._places()[label]])

    def predict_proba(self, X: Any) -> Floats:
        """Return what speaks for each class, (recording, class), as of `dse.deploy.predict.shares`.

        Raises:
            ValueError: as of `predict`.
        """
        _, parts = self._predicted(X)
        shares = np.zeros(parts.shape)
        shares[:, self._places()] = parts
        return shares

    def export(self, folder: str | Path, targets: Sequence[str] = ()) -> Bundle:
        """Write the pick as a bundle, with files of some targets.

        Raises:
            BundleError: a target is unknown, or cannot be written.
        """
        check_is_fitted(self)
        return written(self.bundle_, folder, targets)

    def _predicted(self, X: Any) -> tuple[Array, Floats]:
        check_is_fitted(self)
        X = self._signals(X, reset=False)
        return predicted(self.bundle_, X, self._axes(X))

    def _places(self) -> Array:
        """Return the place in `classes_` of each class of the bundle."""
        names = self.classes_.astype(str).tolist()
        return np.array([names.index(name) for name in self.bundle_.answers])

    def _axes(self, X: Any) -> str | None:
        """Return the axes of what `_signals` returns."""
        named = self.axes.split()
        if isinstance(X, list):
            return " ".join(name for name in named if name != "recording")
        return " ".join(name for name in named if name != "channel" or X.ndim == 3)

    def _signals(self, X: Any, *, reset: bool) -> Any:
        """Return an array, or a list of recordings of unequal length."""
        if hasattr(X, "columns") and len(X) and all(map(np.ndim, X.iloc[0])):
            X = [np.stack(list(map(np.asarray, row))) for row in X.itertuples(index=False)]
        if not isinstance(X, list) or len({np.shape(x) for x in X}) < 2:
            least = 1 + reset  # of which one is held back
            return validate_data(self, X, reset=reset, allow_nd=True, ensure_min_samples=least)
        X = list(map(np.asarray, X))
        channel = [name for name in self.axes.split() if name != "recording"].index("channel")
        n = [x.shape[channel] if x.ndim == 2 else 1 for x in X]
        if reset:
            self.n_features_in_ = n[0]
        if any(x != self.n_features_in_ for x in n):
            raise RecordingError(f"X must have {self.n_features_in_} channels in all recordings, got {n}")
        return X

    def _overrides(self) -> dict[str, str]:
        """Return the settings as the command line takes them."""
        stated = {"seed": self.random_state, "hardware": self.chip and [self.chip], **(self.settings or {})}
        stated |= {"search.stop.minutes": self.minutes} if self.minutes is not None else {}
        return {name: json.dumps(value) for name, value in stated.items() if value is not None}

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: not the study, whose folder stays where it is."""
        state: dict[str, Any] = super().__getstate__()
        return {name: value for name, value in state.items() if name not in ("study_", "pick_")}

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.three_d_array = True
        tags.classifier_tags.poor_score = True  # two-dimensional blobs are no recordings
        return tags
