"""A bundle: the folder that `dse pick --export` writes and `dse evaluate` runs.

bundle.json   schema, how recordings become spikes, the decision rule, the classes, the record, the evidence
weights.npz   trained parameters; of a network: float weights, 8-bit weights, decays, thresholds
plugins/      files of the plugins with its components; reading the bundle runs their code
README.md     the same for people
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dse import registry, store
from dse.config import ConfigError, Sections
from dse.neurons import neuron_of
from dse.neurons.fixed_point import quantise
from dse.records import Array, Head, Network, Parameters
from dse.store import StoreError

_8_BIT = "_8bit"  # ends the names of 8-bit matrices
SCHEMA = "dse/bundle/3"
_WEIGHTS = "weights.npz"
_PLUGINS = "plugins"


class BundleError(ValueError):
    """A folder that is no bundle, a damaged one, or one of a newer schema, in one line."""


@dataclass(frozen=True)
class Input:
    """The recordings that a classifier takes, before encoder and preprocessing.

    kind: samples, which an encoder turns into spikes; spikes; or events, which are preprocessed.
    n_channels: numbers in a step of samples or spikes; 0 of events.
    width, height: frame of events; 0 of others.
    n_steps: length of the window in input steps.
    step_ms: duration of an input step.
    """

    kind: Literal["samples", "spikes", "events"]
    n_channels: int
    width: int
    height: int
    n_steps: int
    step_ms: float


@dataclass(frozen=True)
class Bundle:
    """A classifier that can be deployed.

    fitted: the trained network or parameters; the family of section model runs it.
    sections: of its design, with the values that were fitted to the recordings.
    classes: names of the classes of the whole network.
    phi, theta: the decision rule; both None if the answer comes at a fixed time.
    read_out_ms: that time; None for the end of the window.
    heads: of a joint target; head: the one that answers, '' for all of them together.
    plugins: the plugins with its components: names of modules, or paths of files.
    input: what recordings it takes; None where the export could not tell.
    record: the design point, column -> value.
    evidence: the origin of the numbers.
    """

    fitted: Network | Parameters
    sections: Sections
    classes: tuple[str, ...]
    phi: float | None
    theta: float | None
    record: Mapping[str, object]
    evidence: Mapping[str, Any]
    read_out_ms: float | None = None
    heads: tuple[Head, ...] = ()
    head: str = ""
    plugins: tuple[str, ...] = ()
    input: Input | None = None


def write(bundle: Bundle, folder: Path) -> None:
    """Publish a bundle; an existing bundle is replaced.

    Raises:
        BundleError: the folder holds something else.
        StoreError: it cannot be written.
    """
    if folder.exists() and not (folder / "bundle.json").is_file() and not _is_empty(folder):
        raise BundleError(f"{folder}: exists and is not a bundle; export to another folder")
    with store.published(folder) as temporary:
        temporary.mkdir()
        store.save_arrays(temporary / _WEIGHTS, weights(bundle.fitted))
        plugins = [_copied(source, temporary) for source in bundle.plugins]
        files = [_WEIGHTS, *(name for name in plugins if name.endswith(".py"))]
        document = {
            "schema": SCHEMA,
            "sections": bundle.sections.to_plain(),
            "classes": bundle.classes,
            "decision": {
                "phi": bundle.phi,
                "theta": bundle.theta,
                "undecided": "argmax at the end, lowest class on ties",
                "read_out_ms": bundle.read_out_ms,
                "head": bundle.head,
            },
            "heads": store.heads_document(bundle.heads),
            "input": None if bundle.input is None else asdict(bundle.input),
            "record": bundle.record,
            "evidence": bundle.evidence,
            "plugins": plugins,
            "files": {name: store.checksum(temporary / name) for name in files},
        }
        store.write_json(temporary / "bundle.json", document)
        (temporary / "README.md").write_text(_readme(bundle), encoding="utf-8")
        store.remove(folder)


def read(folder: str | Path) -> Bundle:
    """Return a bundle after checking that it is whole.

    Raises:
        BundleError: it is not, or its schema is newer than this reads.
    """
    path = Path(folder)
    try:
        document = store.read_json(path / "bundle.json")
        if not isinstance(document, dict) or not str(document.get("schema", "")).startswith("dse/bundle/"):
            raise BundleError(f"{path / 'bundle.json'}: is not a bundle of dse")
        if document["schema"] != SCHEMA:
            raise BundleError(
                f"{path / 'bundle.json'}: schema is {document['schema']}, but this version of dse reads "
                f"{SCHEMA}"
            )
        for name, expected in document["files"].items():
            if not (path / name).is_file():
                raise BundleError(f"{path / name}: is missing")
            if store.checksum(path / name) != expected:
                raise BundleError(f"{path / name}: is damaged (its checksum differs)")
        plugins = tuple(
            str(path / name) if name.endswith(".py") else str(name) for name in document["plugins"]
        )
        for source in plugins:  # before their components are named
            registry.load_plugin(source)
        return Bundle(
            fitted=store.fitted_of(
                {k: x for k, x in store.load_arrays(path / _WEIGHTS).items() if not k.endswith(_8_BIT)}
            ),
            sections=Sections.from_plain(document["sections"], str(path / "bundle.json")),
            classes=tuple(document["classes"]),
            phi=document["decision"]["phi"],
            theta=document["decision"]["theta"],
            record=document["record"],
            evidence=document["evidence"],
            read_out_ms=document["decision"]["read_out_ms"],
            heads=store.heads_of(document["heads"]),
            head=document["decision"]["head"],
            plugins=plugins,
            input=None if document.get("input") is None else Input(**document["input"]),
        )
    except (StoreError, ConfigError, registry.PluginError) as error:
        raise BundleError(str(error)) from error
    except (KeyError, TypeError, AttributeError) as error:
        raise BundleError(f"{path / 'bundle.json'}: key {error} is missing or invalid") from error


def weights(fitted: Network | Parameters) -> dict[str, Array]:
    """Return the trained parameters as arrays; a network has the 8-bit matrices of a chip in addition.

    An 8-bit weight w8 in [-128, 127] stands for w8 / 32 (dse.neurons.fixed_point.quantise).
    """
    arrays = store.record_arrays(fitted)
    for k, layer in enumerate(fitted.layers if isinstance(fitted, Network) else ()):
        if "fixed_point" not in neuron_of(layer.neuron).exports:
            continue
        for name, matrix in (("weight", layer.weight), ("recurrent", layer.recurrent)):
            if matrix is not None:
                arrays[f"{k}/{name}{_8_BIT}"] = np.rint(quantise(matrix) * 32).astype(np.int8)
    return arrays


def _copied(source: str, bundle: Path) -> str:
    """Copy the file of a plugin into a bundle; return the name of the plugin in the bundle.

    Raises:
        StoreError: it cannot be read or written.
    """
    if not source.endswith(".py"):
        return source
    folder = bundle / _PLUGINS
    with store.explained(Path(source)):
        code = Path(source).read_bytes()
    folder.mkdir(exist_ok=True)
    name = Path(source).name
    while (folder / name).exists():  # a file of the same name, from another folder
        name = f"_{name}"
    (folder / name).write_bytes(code)
    return f"{_PLUGINS}/{name}"


def _is_empty(folder: Path) -> bool:
    return folder.is_dir() and not any(folder.iterdir())


def _readme(bundle: Bundle) -> str:
    record = "\n".join(f"| {name} | {value} |" for name, value in bundle.record.items())
    what, weights_are = _described(bundle)
    return f"""# {bundle.evidence.get("study", "dse")}: a classifier of {", ".join(_answers(bundle))}

{what}

    dse evaluate THIS_FOLDER --data RECORDINGS

**Decision.** {_rule(bundle)}

**Weights.** {weights_are}

**Input.** How recordings become spikes is in `bundle.json`, `sections`.

| measured (validation unless it says test) | |
| --- | --- |
{record}
"""


def _answers(bundle: Bundle) -> tuple[str, ...]:
    return next((x.classes for x in bundle.heads if x.name == bundle.head), bundle.classes)


def _rule(bundle: Bundle) -> str:
    when = "at the end of the window" if bundle.read_out_ms is None else f"after {bundle.read_out_ms:g} ms"
    if isinstance(bundle.fitted, Parameters):
        return f"The class that the classifier names {when}."
    if bundle.phi is None:
        return f"The class with most output spikes {when} (lowest on ties)."
    return (
        f"The class that has at least the fraction {bundle.theta:g} of the output spikes, at the first step "
        f"with more than {bundle.phi:g} of them; without such a step the class with most at the end (lowest "
        "on ties)."
    )


def _described(bundle: Bundle) -> tuple[str, str]:
    """Return a description of the classifier, and one of its arrays."""
    fitted = bundle.fitted
    if isinstance(fitted, Parameters):
        names = ", ".join(f"`own/{name}`" for name in fitted.arrays)
        kind = bundle.sections.kinds["model"]
        return (
            f"A classifier of family `{kind}` (`dse describe model {kind}`) on {fitted.n_channels} channels.",
            f"`weights.npz` holds what the family stores: {names}.",
        )
    kinds = {layer.neuron: (neuron_of(layer.neuron), layer.parameters) for layer in fitted.layers}
    matrices = (
        "`k/weight` (neuron, input) before 8-bit rounding, `k/weight_8bit` what runs on a chip (value / 32)"
        if all("fixed_point" in neuron.exports for neuron, _ in kinds.values())
        else "`k/weight` (neuron, input)"
    )
    parameters = [
        f"`k/{name}`" + (f" in {neuron.units[name]}" if name in neuron.units else "")
        for neuron, names in kinds.values()
        for name in names
    ]
    labels = " and ".join(neuron.label for neuron, _ in kinds.values())
    return (
        f"A {'-'.join(map(str, fitted.sizes))} network of {labels} neurons ({fitted.arithmetic} arithmetic).",
        "`weights.npz` holds per layer k (0 is nearest the input)"
        f"{', as far as its neurons have them' if len(kinds) > 1 else ''}: "
        f"{', '.join([matrices, *dict.fromkeys(parameters)])}. "
        f"Input column d * {fitted.n_channels} + c is channel c, `delays[d]` steps ago."
        + (" `k/delay` (neuron, input) are the synapses' own delays, steps." if fitted.delay_bits else ""),
    )
