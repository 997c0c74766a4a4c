"""Model families: a frozen dataclass of settings that trains and responds.

Contract: `fit(dataset, training, rngs)` returns an `Outcome`; `rngs(purpose, *index)` gives the random
generator of a purpose, so that a design's result depends on nothing but the design. `respond(fitted, dataset,
samples)` answers anew with what was fitted: a `Response` of spikes, or `Answers` after several input lengths,
with the numbers stored and the operations done by the family's own stated rule. Classifiers of spike counts
extend `dse.models.counts.rate_windows.RateClassifier`.

A family whose designs can train on the same batches also has `shares`, `fit_cohort`, `memory_bytes`,
`workspace_bytes` and `cost`, and the settings `input_delays` and `steps_per_sample`
(`dse.models.snn.family.SNN` is the example).
To add a family, add a file with a dataclass registered in section "models".
"""
