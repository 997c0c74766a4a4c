"""Reaction times of a run: how soon it is at its best, at the human baseline, and near its peak.

The validation set chooses phi, theta and the input length; the test set then says how fast and how accurate
these are on samples that chose nothing.

Source: Brayshaw et al., real-time texture classification, Eqs. (5) and (6); temporal and spatio-temporal
domains, t_C (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.base.registry import Column, register
from dse.measure import decision
from dse.measure.objectives import FullReadOut


def _of_test(name: str, doc: str) -> Column:
    """Return a column of a time, or of the accuracy then, on the test set; no search may use it."""
    is_time = name.endswith("_ms")
    return Column(
        name,
        "ms" if is_time else "",
        "min" if is_time else "max",
        doc,
        of_design=True,
        selects=False,
        ranged=True,
    )


@register("objectives", "reaction_times")
@dataclass(frozen=True)
class ReactionTimes:
    """t_P and t_H over the settings of the decision maker, t_C over input lengths."""

    needs = "full_read_out"
    columns = (
        Column(
            "t_c_ms",
            "ms",
            "min",
            "Shortest input length at which accuracy is within 10 % of its peak.",
            of_design=True,
            ranged=True,
        ),
        Column(
            "t_p_ms",
            "ms",
            "min",
            "Shortest mean decision time among the settings (phi, theta) of best accuracy.",
            of_design=True,
        ),
        Column(
            "t_h_ms",
            "ms",
            "min",
            "Shortest mean decision time among the settings that reach human accuracy.",
            of_design=True,
        ),
        _of_test("accuracy_at_t_c_test", "Accuracy on the test set at the input length t_c_ms."),
        *(
            _of_test(name, f"{what} on the test set at the setting (phi, theta) of {time}_ms.")
            for time in ("t_p", "t_h")
            for name, what in (
                (f"{time}_test_ms", "Mean decision time"),
                (f"accuracy_at_{time}_test", "Accuracy"),
            )
        ),
        Column(
            "t_p_on_border",
            "",
            "min",
            "Fraction of runs whose setting of t_p_ms lies on an end of the grid that changes decisions.",
            of_design=True,
        ),
        Column(
            "output_spikes_most",
            "",
            "min",
            "Most output spikes of a validation sample; a phi that is no smaller decides nothing.",
            of_design=True,
        ),
    )

    def measure(self, answer: FullReadOut) -> Mapping[str, float | None]:
        times: dict[str, float | None] = {}
        read_outs = answer.read_outs
        if read_outs is not None:
            length_ms = decision.t_c(read_outs.decision_latency_ms, read_outs.accuracy)
            times["t_c_ms"] = length_ms
            if read_outs.accuracy_test is not None:
                at = read_outs.decision_latency_ms.tolist().index(length_ms)
                times["accuracy_at_t_c_test"] = float(read_outs.accuracy_test[at])
        if answer.decisions is None:
            return times
        peak, at_human = decision.t_p(answer.decisions), decision.t_h(answer.decisions)
        for name, setting in (("t_p", peak), ("t_h", at_human)):
            times[f"{name}_ms"] = None if setting is None else setting.decision_latency_ms
            if answer.decisions_test is not None:
                of_test = None if setting is None else decision.at(answer.decisions_test, setting)
                times[f"{name}_test_ms"] = None if of_test is None else of_test.decision_latency_ms
                times[f"accuracy_at_{name}_test"] = None if of_test is None else of_test.accuracy
        times["output_spikes_most"] = answer.most_output_spikes
        n_classes = len(answer.confusion)
        times["t_p_on_border"] = float(decision.on_border(answer.decisions, peak, n_classes))
        return times
