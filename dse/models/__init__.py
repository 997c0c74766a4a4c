"""Model families: a frozen dataclass of settings that trains and responds.

The contract is `dse.config.contracts.Family`, and `CohortFamily` for a family whose designs train on the same
batches (`dse.models.snn.family.SNN` is the example); `dse.testing.check_family` checks both. A classifier of
spike counts extends `dse.models.counts.rate_windows.RateClassifier`.

To add a family, add a file with a dataclass registered in section "models", here or in a module of your own.
"""
