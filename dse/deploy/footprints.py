"""What design points of a study take on targets, known before they are exported."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dse.base import registry
from dse.base.records import Network
from dse.config.faults import known_names
from dse.config.locate import shipped_profiles
from dse.deploy.bundle import BundleError
from dse.deploy.export import bundle_of
from dse.deploy.verify import target_named
from dse.measure.hardware.kinds.gate_array import GateArray
from dse.measure.hardware.kinds.processor import Processor
from dse.measure.hardware.profile import Profile, load
from dse.study import pricing
from dse.study.results import Study

if TYPE_CHECKING:
    import pandas

_SAME = ("trial", "task", "weight_bits", "pruned_after")
"""Columns by which footprints differ; beside them the kind of decision, but not its phi, theta or time."""


def on_targets(
    study: Study, points: pandas.DataFrame, names: Sequence[str], hardware: Sequence[str] = ()
) -> tuple[pandas.DataFrame, list[str]]:
    """Return points with their footprints on targets, and a sentence per target that cannot hold some.

    Args:
        study: of the points.
        points: some of `study.points()`.
        names: of targets.
        hardware: as in `pricing.points`, if the points are from there.

    Returns:
        The points once per target that knows its footprint, with the columns `target`, those of `footprint`
        (dse.deploy.targets.Target) and `cycles`: per inference, as the cost model of the target's profile
        predicts from the work on validation recordings up to the decision, mean over runs; NaN without a
        profile, and of classifiers of counts that earlier versions trained. Where the hardware of a point is
        a profile of the target, both are of that one. Points that a target cannot hold are left out there.

    Raises:
        BundleError: a target, of a profile too, is unknown, or no target can hold any of the points.
        ConfigError: as in `pricing.points`.
        StoreError: an artefact is damaged.
    """
    import pandas

    named: dict[str, Any] = {name: target_named(name) for name in names}
    targets = {name: target for name, target in named.items() if hasattr(target, "footprint")}
    if not targets:
        return points, []
    usual = {name: load(x.profile) if getattr(x, "profile", "") else None for name, x in targets.items()}
    others = _others(study, points, hardware, usual)
    groups = points.groupby(_keys(points), sort=False, dropna=False).indices.values()
    parts: dict[str, list[pandas.DataFrame]] = {name: [] for name in targets}
    refusals: dict[str, Counter[str]] = {name: Counter() for name in targets}
    counted: list[int] = []
    for places in groups:
        rows = points.iloc[places]
        try:
            bundle = bundle_of(study, {str(k): x for k, x in rows.iloc[0].items()})
        except BundleError as error:
            for counts in refusals.values():
                counts[str(error)] += len(rows)
            continue
        if isinstance(bundle.fitted, Network) or pricing.work_is_counted(study.folder, rows):
            counted += rows.index.tolist()
        for name, target in targets.items():
            if refusal := target.refusal(bundle):
                refusals[name][refusal] += len(rows)
            else:
                for chip, on_chip in _by_chip(rows, others[name]):
                    taken = target.footprint(bundle, chip) if chip else target.footprint(bundle)
                    parts[name].append(on_chip.assign(target=name, **taken))
    frames = []
    for name, of_target in parts.items():
        if of_target:
            rows = pandas.concat(of_target).sort_index()
            known = rows[rows.index.isin(counted)]
            by_chip = _by_chip(known, others[name])
            cycles = [_cycles(study, on_chip, chip or usual[name]) for chip, on_chip in by_chip]
            frames.append(rows.assign(cycles=pandas.concat(cycles)))
    notes = [
        f"target {name} cannot hold {n} of {len(points)} points: {refusal}"
        for name, counts in refusals.items()
        for refusal, n in counts.items()
    ]
    if not frames:
        raise BundleError("\n".join(notes) or "there are no points")
    return pandas.concat(frames, ignore_index=True), notes


def _others(
    study: Study, points: pandas.DataFrame, hardware: Sequence[str], usual: Mapping[str, Profile | None]
) -> dict[str, dict[str, Profile]]:
    """Return per target the profiles of points on which it runs otherwise than on its usual one, by name."""
    others: dict[str, dict[str, Profile]] = {name: {} for name in usual}
    asked = {chip.name: chip for chip in pricing.profiles(study.folder, hardware)}
    for name in points["hardware"].dropna().unique() if "hardware" in points else ():
        is_shipped = name in shipped_profiles()
        chip = load(name) if is_shipped else asked.get(name) or pricing.kept(study.folder, name)
        if chip.target and chip.target not in (known := registry.known("targets")):
            text = f"hardware profile '{name}': target '{chip.target}' is unknown"
            raise BundleError(f"{text}; {known_names(chip.target, known)}")
        base = usual.get(chip.target)
        if chip is not base and type(chip) is type(base):
            others[chip.target][name] = chip
    return others


def _by_chip(
    rows: pandas.DataFrame, others: Mapping[str, Profile]
) -> list[tuple[Profile | None, pandas.DataFrame]]:
    """Return the points on each of some profiles and, with None, those on no such profile."""
    if rows.empty or not others:
        return [(None, rows)]
    name = rows["hardware"].where(rows["hardware"].isin(list(others)), "")
    return [(others.get(str(key)), part) for key, part in rows.groupby(name, sort=False)]


def _cycles(study: Study, rows: pandas.DataFrame, chip: Profile | None) -> pandas.Series[float]:
    """Return the cycles per inference that a profile predicts, with the index of the rows."""
    import pandas

    if chip is None or rows.empty:
        return pandas.Series(math.nan, rows.index)
    assert isinstance(chip, Processor | GateArray)
    [costs] = pricing.costs(study.folder, rows, [chip])
    return costs["hardware_latency_ms"] * chip.cycles_per_ms


def _keys(points: pandas.DataFrame) -> list[Any]:
    """Return what points are grouped by: points of one group take the same."""
    kinds = [points[name].notna().rename(f"has {name}") for name in ("phi", "read_out_ms") if name in points]
    return [*(points[name] for name in _SAME if name in points), *kinds]
