"""Records as named arrays in .npz files: what was trained, and what it answered."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np

from dse.records import Answers, Arithmetic, Array, Layer, Network, Operations, Parameters, Response, Workload
from dse.store.files import StoreError

# In front of the names of a family's own arrays, and of those of its work.
_OWN = "own/"
_WORK = "work/"


def save_arrays(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write a compressed .npz."""
    with path.open("wb") as file:
        np.savez_compressed(file, **dict(arrays))  # type: ignore[arg-type]


def load_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of an .npz.

    Raises:
        StoreError: the file is missing or damaged.
    """
    try:
        # Opened here: numpy leaves a file open that turns out to be damaged.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as found:
            return {name: found[name] for name in found.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise StoreError(f"{path}: cannot be read: {error}") from error


def network_arrays(network: Network) -> dict[str, Array]:
    """Return a network as named arrays, layer k's under `<k>/`; `network_of` reads them back."""
    arrays: dict[str, Array] = {
        "n_layers": np.array(len(network.layers)),
        "n_channels": np.array(network.n_channels),
        "delays": np.array(network.delays, np.int64),
        "steps_per_sample": np.array(network.steps_per_sample),
        "arithmetic": np.array(network.arithmetic),
    }
    for k, layer in enumerate(network.layers):
        arrays[f"{k}/weight"] = layer.weight
        if layer.recurrent is not None:
            arrays[f"{k}/recurrent"] = layer.recurrent
        arrays[f"{k}/decay_current"] = layer.decay_current
        arrays[f"{k}/decay_voltage"] = layer.decay_voltage
        arrays[f"{k}/threshold"] = np.array(layer.threshold)
    return arrays


def network_of(arrays: Mapping[str, Array]) -> Network:
    """Return the network of `network_arrays`.

    Raises:
        StoreError: an array is missing.
    """
    try:
        layers = tuple(
            Layer(
                weight=arrays[f"{k}/weight"],
                recurrent=arrays.get(f"{k}/recurrent"),
                decay_current=arrays[f"{k}/decay_current"],
                decay_voltage=arrays[f"{k}/decay_voltage"],
                threshold=int(arrays[f"{k}/threshold"]),
            )
            for k in range(int(arrays["n_layers"]))
        )
        return Network(
            layers=layers,
            n_channels=int(arrays["n_channels"]),
            delays=tuple(int(x) for x in arrays["delays"]),
            steps_per_sample=int(arrays["steps_per_sample"]),
            arithmetic=cast(Arithmetic, str(arrays["arithmetic"])),
        )
    except KeyError as error:
        raise StoreError(f"a network needs the array {error}") from error


def fitted_arrays(fitted: Network | Parameters) -> dict[str, Array]:
    """Return what a family trained as named arrays; `fitted_of` reads them back."""
    if isinstance(fitted, Network):
        return network_arrays(fitted)
    own = {f"{_OWN}{name}": np.asarray(x) for name, x in fitted.arrays.items()}
    return {"n_channels": np.array(fitted.n_channels), **own}


def fitted_of(arrays: Mapping[str, Array]) -> Network | Parameters:
    """Return what `fitted_arrays` was given.

    Raises:
        StoreError: an array is missing.
    """
    if "n_layers" in arrays:
        return network_of(arrays)
    if "n_channels" not in arrays:
        raise StoreError("a trained classifier needs the array 'n_channels'")
    own = {name.removeprefix(_OWN): x for name, x in arrays.items() if name.startswith(_OWN)}
    return Parameters(own, int(arrays["n_channels"]))


def answers_arrays(answers: Answers, index: Array) -> dict[str, Array]:
    """Return answers as named arrays; `index` (n,) are the numbers of the samples."""
    return {"index": np.asarray(index), **{name: np.asarray(x) for name, x in vars(answers).items()}}


def response_arrays(response: Response, index: Array) -> dict[str, Array]:
    """Return a response as named arrays; `response_of` reads them back.

    Args:
        response: its output spikes are binary, so eight go into a byte.
        index: (n,) sample numbers that were answered.
    """
    return {
        "index": np.asarray(index),
        "shape": np.array(response.output.shape),
        "output": np.packbits(response.output),
        "spikes": response.spikes,
        "updates": response.updates,
        "step_ms": np.array(response.step_ms),
        "peak_state": np.array(response.peak_state),
        **({} if response.synapses is None else {"synapses": np.array(response.synapses)}),
    }


def response_of(arrays: Mapping[str, Array]) -> Response:
    """Return the response of `response_arrays`."""
    shape = tuple(int(n) for n in arrays["shape"])
    output = np.unpackbits(arrays["output"], count=int(np.prod(shape))).reshape(shape)
    return Response(
        output,
        arrays["spikes"],
        arrays["updates"],
        float(arrays["step_ms"]),
        int(arrays["peak_state"]),
        tuple(arrays["synapses"].tolist()) if "synapses" in arrays else None,
    )


def work_arrays(load: Workload | Operations) -> dict[str, Array]:
    """Return a load as named arrays under `work/`; `work_of` reads them back."""
    return {f"{_WORK}{name}": np.asarray(x) for name, x in vars(load).items() if x is not None}


def work_of(arrays: Mapping[str, Array]) -> Workload | Operations:
    """Return the load of `work_arrays`, from among other arrays.

    Raises:
        StoreError: an array is missing.
    """
    own = {name.removeprefix(_WORK): x for name, x in arrays.items() if name.startswith(_WORK)}
    try:
        if "macs" in own:
            return Operations(
                macs=own["macs"],
                additions=own["additions"],
                updates=own["updates"],
                n_weights=own["n_weights"],
                duration_ms=own["duration_ms"],
                number_bits=int(own["number_bits"]),
            )
        return Workload(
            sizes=tuple(own["sizes"].tolist()),
            recurrent=tuple(own["recurrent"].tolist()),
            n_steps=own["n_steps"],
            spikes=own["spikes"],
            updates=own.get("updates"),
            step_ms=float(own["step_ms"]),
            weight_bits=int(own["weight_bits"]),
            synapses=tuple(own["synapses"].tolist()) if "synapses" in own else None,
            stored=tuple(own["stored"].tolist()) if "stored" in own else None,
        )
    except KeyError as error:
        raise StoreError(f"work needs the array {error}") from error
