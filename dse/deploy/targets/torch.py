"""PyTorch: the network as a module in a file, for whatever runs torch.

module.pt    weights, neurons and delays: tensors and plain values, which `torch.load(..., weights_only=True)`
             reads; `dse.deploy.module.load` returns the module

The module calculates as the engine does (dse.deploy.module).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Ints, Network
from dse.base.registry import register
from dse.deploy.bundle import Bundle
from dse.deploy.form import network_in
from dse.deploy.reference import Reference
from dse.deploy.run import require
from dse.deploy.targets import BackEnd, Engine, Run

_FILE = "module.pt"
_MOST_NUMBERS = 2**25  # of inputs in the steps of a batch
_MOST_RECORDINGS = 128


@register("targets", "torch")
@dataclass(frozen=True)
class Torch(BackEnd[Network]):
    """The network as a torch module, with the same spikes."""

    label: ClassVar[str] = "PyTorch module"
    extra: ClassVar[str] = "torch"
    use: ClassVar[str] = "`dse.deploy.module.load(Path('targets/torch/module.pt'))` returns the module"

    def form(self, bundle: Bundle) -> Network:
        """Return the network itself: the module rounds its weights."""
        return network_in(bundle, "torch modules hold")

    def emit(self, form: Network, bundle: Bundle, folder: Path) -> None:
        """Write module.pt."""
        require("torch", "torch")
        from dse.deploy.module import save

        save(form, folder / _FILE)

    def engines(self, form: Network, bundle: Bundle, folder: Path, reference: Reference) -> Iterator[Engine]:
        """Run the module in the file."""
        require("torch", "torch")
        import torch

        from dse.deploy.module import listed, load

        module = load(folder / _FILE).eval()
        rows = reference.arriving(module.network)  # of the file
        size = max(1, min(_MOST_RECORDINGS, _MOST_NUMBERS // (rows.n_steps * rows.n_inputs)))
        fired: list[list[Ints]] = [[np.zeros((0, 3), np.int64)] for _ in reference.fired]
        with torch.no_grad():
            for first in range(0, rows.n_samples, size):
                batch = module.run(rows, slice(first, min(first + size, rows.n_samples)))
                for layer, of_layer in zip(fired, batch, strict=True):
                    layer.append(listed(of_layer.transpose(0, 1), first))
        run = Run.of_fired(bundle, reference, [np.concatenate(x) for x in fired])
        yield Engine((f"torch {torch.__version__}",), run)
