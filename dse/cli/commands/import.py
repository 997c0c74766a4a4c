"""`dse import`: put weights that were trained on in torch back into a bundle."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dse.cli.answer import Answer
from dse.cli.fields import argument, formats, option

GROUP = "deploy"
HELP = (
    "put weights that were trained on in torch (bundle.as_module()) back: a new bundle, measured and priced"
)


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    bundle: str = argument("BUNDLE", "the bundle whose module was trained on")
    weights: str | None = argument(
        "FILE",
        "written by torch.save(module.state_dict(), FILE) (default: those that BUNDLE was made with)",
        None,
    )
    data: str | None = option(
        "RECORDINGS", "labelled recordings, as of `dse evaluate`; the new bundle's record is measured on them"
    )
    out: str | None = option("DIR", "folder of the new bundle")
    into: str | None = option(
        "RESULTS",
        "add a trial to the study that the bundle is from, measured on its recordings; its column origin "
        "says what it was",
    )
    hardware: str | None = option(
        "NAME", "compute costs on this profile (default: that of the bundle's record)"
    )
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Return the record of the new bundle, or the row of the new trial."""
    from dse.deploy.bundle import BundleError, read
    from dse.deploy.tuned import import_into, import_weights, with_weights
    from dse.native.extras import require_torch

    if bool(arguments.data) != bool(arguments.out):
        raise BundleError("--data, the recordings to measure on, and --out, the new bundle, need each other")
    if not (arguments.out or arguments.into):
        raise BundleError("import needs --data RECORDINGS and --out DIR, or --into RESULTS")
    if arguments.out and not arguments.weights:
        raise BundleError("--out needs FILE, the weights of the new bundle")
    notes, bundle = [], None
    if arguments.out:
        assert arguments.weights and arguments.data  # as stated above
        bundle = import_weights(
            arguments.bundle, arguments.weights, arguments.data, arguments.out, arguments.hardware
        )
        notes.append(f"bundle: {arguments.out}")
    if arguments.into:
        bundle = bundle or read(arguments.bundle)
        if arguments.weights and not arguments.out:
            require_torch("importing a torch module")
            bundle = with_weights(bundle, Path(arguments.weights))
        return _into(arguments.into, import_into(bundle, arguments.into), notes)
    assert bundle is not None
    shown = (
        "trial",
        "phi",
        "theta",
        "read_out_ms",
        "accuracy",
        "decision_latency_ms",
        "n_weights",
        "energy_uj",
    )
    columns = [name for name in shown if bundle.record.get(name) is not None]
    return Answer([dict(bundle.record)], notes, columns)


def _into(results: str, trial: int, notes: list[str]) -> Answer:
    """Return the row of a new trial of a study."""
    from dse.store import plain_cell
    from dse.study.results import open as open_study

    trials = open_study(results).trials
    [row] = trials[trials["trial"] == trial].to_dict("records")
    plain = {str(name): plain_cell(x) for name, x in row.items()}
    columns = [name for name in ("trial", "origin", "accuracy", "accuracy_se", "energy_uj") if name in plain]
    return Answer([plain], [*notes, f"trial {trial} of {results}"], columns)
