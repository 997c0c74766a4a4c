"""`dse import`: put weights that were trained on in torch back into a bundle."""

from __future__ import annotations

import argparse

from dse.cli.answer import Answer, add_format

GROUP = "deploy"
HELP = (
    "put weights that were trained on in torch (bundle.as_module()) back: a new bundle, measured and priced"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bundle", metavar="BUNDLE", help="the bundle whose module was trained on")
    parser.add_argument("weights", metavar="FILE", help="written by torch.save(module.state_dict(), FILE)")
    parser.add_argument(
        "--data",
        required=True,
        metavar="RECORDINGS",
        help="labelled recordings, as of `dse evaluate`; the new bundle's record is measured on them",
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="folder of the new bundle")
    parser.add_argument(
        "--hardware",
        metavar="NAME",
        help="compute costs on this profile (default: that of the bundle's record)",
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the record of the new bundle."""
    from dse.deploy.tuned import import_weights

    bundle = import_weights(
        arguments.bundle, arguments.weights, arguments.data, arguments.out, arguments.hardware
    )
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
    return Answer([dict(bundle.record)], [f"bundle: {arguments.out}"], columns)
