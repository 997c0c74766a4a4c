"""A bundle: the folder that `dse pick --export` writes and `dse evaluate` runs.

bundle.json   schema, how recordings become spikes, the decision rule, the classes, the record, the evidence,
              the verdict on every target, the checksums of all files and of itself
weights.npz   trained parameters; of a network: float weights, 8-bit weights, decays, thresholds
plugins/      files of the plugins with its components; reading the bundle runs their code
targets/      a folder for every target (dse.deploy.targets)
README.md     the model card (dse.deploy.card)
statement.json  what it follows from, for tools (dse.deploy.statement)
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

import numpy as np

from dse import store
from dse.base import registry
from dse.base.native.extras import require_torch
from dse.base.records import Array, Network, Parameters
from dse.base.registry import param
from dse.config import ConfigError, Sections
from dse.config.values import read_object, refuse
from dse.deploy import checks
from dse.deploy.card import card, stated
from dse.deploy.classifier import RULE, BundleError, Classifier, Input, InputKind
from dse.deploy.prefix import DEFAULT, checked
from dse.deploy.statement import digest, statement
from dse.deploy.stream import Item, Stream, Windows
from dse.deploy.verdict import Verdict
from dse.deploy.window import Decision
from dse.engine.checks import check_network
from dse.engine.neurons import neuron_of
from dse.engine.neurons.fixed_point import quantise
from dse.store import StoreError

if TYPE_CHECKING:
    from dse.deploy.module import NetworkModule

__all__ = [
    "SCHEMA",
    "Bundle",
    "BundleError",
    "Input",
    "InputKind",
    "check_unedited",
    "read",
    "sealed",
    "target_files",
    "weights",
    "write",
]

_8_BIT = "_8bit"  # ends the names of 8-bit matrices
_SCHEMA = "dse/bundle/"
SCHEMA = f"{_SCHEMA}4"
_DOCUMENT = "bundle.json"
_TARGETS = "targets"
_WEIGHTS = "weights.npz"
_PLUGINS = "plugins"
_README = "README.md"
_STATEMENT = "statement.json"
_SHARED, _PLAIN = ("classes", "prefix", "input"), ("record", "evidence")
"""Keys of bundle.json that are fields of a bundle, and those whose values are as JSON holds them."""


@dataclass(frozen=True)
class Bundle(Classifier):
    """A classifier as its folder holds it."""

    def __repr__(self) -> str:
        """Return one line: the arrays of a network fill pages."""
        accuracy = self.record.get("accuracy")
        measured = f", accuracy {accuracy:.3f}" if isinstance(accuracy, float) else ""
        targets = "".join(f", {name}: {verdict.kind}" for name, verdict in self.targets.items())
        return f"<Bundle {self.record.get('family')}: {len(self.classes)} classes{measured}{targets}>"

    @property
    def digest(self) -> str:
        """SHA-256 of what answers: weights, design, decision rule, classes; of nothing that was measured."""
        content = {**self.rule, "classes": self.classes, "heads": store.heads_document(self.heads)}
        content |= {"weights": digest(weights(self.fitted)), "sections": self.sections.to_plain()}
        text: str = sealed(content)["checksum"]
        return text

    def stream(self, source: Iterable[Item], windows: Windows | None = None) -> Iterator[Decision]:
        """Yield decisions as samples or events arrive.

        Args:
            source: per step the numbers of a sample, or 0 and 1 of a raster; or blocks of events.
            windows: where windows begin; None: as in training (`dse.deploy.stream.Stream`).

        Raises:
            BundleError: the bundle cannot run on a stream.
            RecordingError: an item does not fit.
        """
        yield from Stream(self, windows).decisions(source)

    def predict(self, data: Any, axes: str | None = None) -> Array:
        """Return the answers to recordings, (n,) names of classes; None where heads answer no known pair.

        Args:
            data: a file, or arrays as of `dse.data.from_arrays`.
            axes: of arrays; None: recording, step, channel.

        Raises:
            BundleError: arrays for a classifier of events, or the classifier refuses the recordings.
            RecordingError: the recordings do not fit.
        """
        from dse.deploy.predict import predicted

        return np.array([self.named(label) for label in predicted(self, data, axes)[0].tolist()])

    def score(self, data: Any, labels: Iterable[Any], axes: str | None = None) -> float:
        """Return the share of recordings whose label is answered; arguments and errors as of `predict`."""
        return float(np.mean(self.predict(data, axes) == np.array([str(x) for x in labels])))

    def as_module(self) -> NetworkModule:
        """Return the network as a torch module with the same spikes, bit for bit in integer arithmetic.

        Raises:
            BundleError: the classifier is no network.
            MissingExtra: torch is not installed.
        """
        require_torch("a bundle as a module")
        from dse.deploy.module import NetworkModule

        if not isinstance(self.fitted, Network):
            kind = self.sections.kinds["model"]
            raise BundleError(f"only networks of neurons are torch modules, and family {kind} is none")
        return NetworkModule(self.fitted)


def write(bundle: Bundle, folder: Path, targets: Mapping[str, Mapping[str, Path]] | None = None) -> None:
    """Publish a bundle; an existing bundle is replaced, other files in its folder stay.

    Args:
        bundle: with the verdicts of its targets.
        folder: of the bundle.
        targets: the files of each target, by their names in its folder; without it, verdicts of targets that
            have files are left out.

    Raises:
        BundleError: the folder holds something else.
        StoreError: it cannot be written.
    """
    is_empty = folder.is_dir() and not any(folder.iterdir())
    if folder.exists() and not (folder / _DOCUMENT).is_file() and not is_empty:
        raise BundleError(f"{folder}: exists and is not a bundle; export to another folder")
    sources = {} if targets is None else targets
    verdicts = {x: v for x, v in bundle.targets.items() if x in sources or v.kind == "unsupported"}
    with store.published(folder) as temporary:
        temporary.mkdir()
        arrays, sections = weights(bundle.fitted), bundle.sections.to_plain()
        store.save_arrays(temporary / _WEIGHTS, arrays)
        stated = statement(
            sections, bundle.evidence, arrays, {_WEIGHTS: store.checksum(temporary / _WEIGHTS)}
        )
        (temporary / _STATEMENT).write_text(f"{json.dumps(stated, indent=1, default=store.plain)}\n", "utf-8")
        plugins = tuple(_copied(source, temporary) for source in bundle.plugins)
        (temporary / _README).write_text(card(bundle, verdicts), encoding="utf-8")
        files = [_WEIGHTS, _README, _STATEMENT, *(name for name in plugins if name.endswith(".py"))]
        for name, source in sources.items():
            for file, path in sorted(source.items()):
                files.append(f"{_TARGETS}/{name}/{file}")
                (temporary / files[-1]).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, temporary / files[-1])
        document = _Document(
            schema=SCHEMA,
            sections=sections,
            decision=_Decision(**bundle.rule),
            heads=tuple(_Head(**head) for head in store.heads_document(bundle.heads)),
            plugins=plugins,
            targets=verdicts,
            files={name: store.checksum(temporary / name) for name in files},
            **{name: getattr(bundle, name) for name in (*_SHARED, *_PLAIN)},
        )
        content = json.dumps(sealed(dataclasses.asdict(document)), indent=1, default=store.plain) + "\n"
        (temporary / _DOCUMENT).write_text(content, encoding="utf-8")
        _copy_others(folder, temporary)
        store.remove(folder)


@dataclass(frozen=True, kw_only=True)
class _Decision:
    """The decision rule, as bundle.json holds it."""

    phi: float | None = param(low=0)
    theta: float | None = param(low=0, high=1)
    undecided: str = "argmax at the end, lowest class on ties"
    read_out_ms: float | None = param(low=0)
    head: str


@dataclass(frozen=True)
class _Head:
    """A part of a joint target (`dse.base.records.Head`)."""

    name: str
    classes: tuple[str, ...]
    of_class: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class _Document:
    """bundle.json, without its own checksum; files: name -> checksum."""

    schema: str
    sections: Mapping[str, Any]
    classes: tuple[str, ...]
    decision: _Decision
    heads: tuple[_Head, ...]
    prefix: str = DEFAULT
    input: Input | None
    record: Mapping[str, Any]
    evidence: Mapping[str, Any]
    plugins: tuple[str, ...]
    targets: Mapping[str, Verdict]
    files: Mapping[str, Any]


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a document of bundle.json with the checksum of its content, under `checksum`."""
    content = {key: store.plain(value) for key, value in document.items() if key != "checksum"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return {**content, "checksum": hashlib.sha256(text.encode()).hexdigest()}


def read(folder: str | Path, edited: Collection[str] = ()) -> Bundle:
    """Return a bundle after checking that it is whole; code of its plugins runs if the user consents.

    Args:
        folder: of the bundle.
        edited: targets whose files may be other than what was written.

    Raises:
        BundleError: it is damaged, disagrees with itself, or has another schema.
    """
    path = Path(folder)
    where = path / _DOCUMENT
    try:
        document = _document(path)
        where = path
        _check_files(path, document, edited)
        if unlisted := [x for x in document.plugins if x.endswith(".py") and x not in document.files]:
            raise ValueError(f"plugin {unlisted[0]} must be one of its files")
        sources = tuple(str(path / name) if name.endswith(".py") else name for name in document.plugins)
        where = path / _WEIGHTS
        checks.check_archive(where)
        arrays = store.load_arrays(where)
        where = path / _DOCUMENT
        for source in sources:  # before their components are named
            registry.load_plugin(source, named_by=path)
        bundle = _bundle(document, arrays, str(where), sources)
        where = path / _WEIGHTS
        _check_classifier(bundle, arrays)
    except BundleError:
        raise
    except (StoreError, ConfigError, registry.PluginError) as error:
        text = str(error).replace(store.REMEDY, "export the design again")
        raise BundleError(text if str(path) in text else f"{where}: {text}") from error
    except RecursionError:
        raise BundleError(f"{where}: is nested too deeply") from None
    except KeyError as error:
        raise BundleError(f"{where}: key {error} is missing or invalid") from error
    except (*store.DAMAGED_ARCHIVE, TypeError, AttributeError, IndexError, OverflowError) as error:
        raise BundleError(f"{where}: {' '.join(str(error).split())}") from error
    return bundle


def check_unedited(folder: Path) -> None:
    """Check that no file of a target was edited; a folder without a bundle, or with a damaged one, passes."""
    try:
        files = _document(folder).files
    except (BundleError, StoreError, ValueError):
        return
    for name, expected in files.items():
        path = folder / name
        if name.startswith(f"{_TARGETS}/") and path.is_file() and store.checksum(path) != expected:
            raise BundleError(f"{path}: was edited, and would be lost; --force (force=True) replaces it")


def target_files(folder: Path, name: str) -> dict[str, Path]:
    """Return the files of a target that a bundle lists, by their names in the target's folder."""
    root = f"{_TARGETS}/{name}/"
    try:
        own = [listed for listed in _document(folder).files if listed.startswith(root)]
        return {listed.removeprefix(root): checks.file_in(folder, listed) for listed in own}
    except BundleError:
        raise
    except ValueError as error:
        raise BundleError(f"{folder}: {error}") from None


def _document(folder: Path) -> _Document:
    """Return bundle.json, checked against its own checksum.

    Raises:
        BundleError: it is of another schema, or no bundle.
        ValueError: it is damaged.
        StoreError: it cannot be read.
    """
    try:
        path = checks.file_in(folder, _DOCUMENT)
    except ValueError as error:
        no_bundle = (
            f"{folder}: is not the folder of a bundle: there is no {_DOCUMENT}; dse pick --export writes one"
        )
        is_there = (folder / _DOCUMENT).exists()
        raise BundleError(f"{folder / _DOCUMENT}: {error}" if is_there else no_bundle) from None
    if path.stat().st_size > checks.MOST_DOCUMENT_BYTES:
        raise ValueError(f"must have at most {checks.MOST_DOCUMENT_BYTES} bytes, got {path.stat().st_size}")
    content = store.read_json(path)  # it holds a checksum of its own
    schema = str(content.get("schema", "")) if isinstance(content, dict) else ""
    version = schema.removeprefix(_SCHEMA)
    if not schema.startswith(_SCHEMA) or not version.isdecimal():
        raise BundleError(f"{path}: is not a bundle of dse")
    if schema != SCHEMA:
        other = "an older version of dse wrote it; export the design again"
        if int(version[:9]) > int(SCHEMA.removeprefix(_SCHEMA)):
            other = "a newer version of dse wrote it"
        raise BundleError(f"{path}: schema is {schema}, but this version of dse reads {SCHEMA}: {other}")
    if content.get("checksum") != sealed(content)["checksum"]:
        raise ValueError("is damaged (its checksum differs)")
    document = read_object(_Document, content, (), refuse, also=("checksum",))
    assert document is not None  # a mistake raises
    if names := [name for name in document.targets if not name.isidentifier()]:
        raise ValueError(f"target '{names[0]}' must be a word")
    return document


def _check_files(folder: Path, document: _Document, edited: Collection[str]) -> None:
    """Check that the files of a bundle are as it lists them; others, such as programs, are ignored."""
    files = document.files
    if _WEIGHTS not in files:
        raise ValueError(f"key 'files' must list {_WEIGHTS}")
    for name, expected in files.items():
        is_of_target, (_, target, *_) = name.startswith(f"{_TARGETS}/"), [*name.split("/"), ""]
        if is_of_target and target in edited:
            continue
        try:
            path = checks.file_in(folder, name)
        except ValueError as error:
            raise BundleError(f"{folder}/{name}: {error}") from None
        if store.checksum(path) != expected:
            remedy = f"; `dse export --target {target} --force` writes it anew" if is_of_target else ""
            raise BundleError(f"{path}: is damaged or edited (its checksum differs){remedy}")
        if is_of_target and target not in document.targets:
            raise BundleError(f"{folder / name}: is of no target of {_DOCUMENT}")


def _bundle(document: _Document, arrays: Mapping[str, Array], where: str, plugins: tuple[str, ...]) -> Bundle:
    """Return the bundle of a document and its arrays."""
    decision, classes = document.decision, document.classes
    if not classes:
        raise ValueError("key 'classes' must name at least one class")
    if (decision.phi is None) != (decision.theta is None):
        raise ValueError("keys 'decision.phi' and 'decision.theta' must both be numbers or null")
    heads = store.heads_of(map(vars, document.heads))
    checks.check_heads(heads, len(classes), decision.head)
    checked(document.prefix)
    bundle = Bundle(
        fitted=store.fitted_of({k: x for k, x in arrays.items() if not k.endswith(_8_BIT)}),
        sections=Sections.from_plain(document.sections, where),
        heads=heads,
        plugins=plugins,
        targets=document.targets,
        **{name: getattr(decision, name) for name in RULE},
        **{name: getattr(document, name) for name in _SHARED},
        **{name: store.plain(getattr(document, name)) for name in _PLAIN},
    )
    stated(bundle.evidence, len(bundle.answers))  # a mistake raises
    return bundle


def _check_classifier(bundle: Bundle, arrays: Mapping[str, Array]) -> None:
    """Check the arrays of a classifier; 8-bit matrices, which others read, must be those of the network."""
    fitted, model = bundle.fitted, bundle.sections.model
    expected = _fitted_type(model)
    if not isinstance(fitted, expected):
        raise ValueError(f"must hold {expected.__name__} for model.kind {bundle.sections.kinds['model']}")
    if isinstance(fitted, Parameters):
        checks.check_parameters(fitted)
        check_fitted = getattr(model, "check_fitted", None)
        if check_fitted is not None:
            check_fitted(fitted, bundle.n_outputs)
        return
    check_network(fitted, bundle.n_outputs)
    for name, matrix in _8_bit(fitted).items():
        if name not in arrays or not np.array_equal(arrays[name], matrix):
            raise ValueError(f"array '{name}' must be the 8-bit rounding of '{name.removesuffix(_8_BIT)}'")


def _fitted_type(model: object) -> type:
    """Return the class that a family's `respond` reads; `object` where its annotation names none."""
    with contextlib.suppress(AttributeError, NameError, TypeError):  # a family of a user's module
        hint = get_type_hints(model.respond).get("fitted")  # type: ignore[attr-defined]
        if isinstance(hint, type):
            return hint
    return object


def weights(fitted: Network | Parameters) -> dict[str, Array]:
    """Return the trained parameters as arrays; a network has the 8-bit matrices of a chip in addition.

    An 8-bit weight w8 in [-128, 127] stands for w8 / 32 (dse.engine.neurons.fixed_point.quantise).
    """
    return store.record_arrays(fitted) | _8_bit(fitted)


def _8_bit(fitted: Network | Parameters) -> dict[str, Array]:
    arrays = {}
    for k, layer in enumerate(fitted.layers if isinstance(fitted, Network) else ()):
        if "fixed_point" not in neuron_of(layer.neuron).exports:
            continue
        for name, matrix in (("weight", layer.weight), ("recurrent", layer.recurrent)):
            if matrix is not None:
                arrays[f"{k}/{name}{_8_BIT}"] = np.rint(quantise(matrix) * 32).astype(np.int8)
    return arrays


def _copied(source: str, bundle: Path) -> str:
    """Copy the file of a plugin into a bundle; return the name of the plugin in the bundle."""
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


def _copy_others(folder: Path, bundle: Path) -> None:
    """Copy what is none of a bundle's own files from its old folder to the new one.

    Of the folders of targets, what is not listed is copied where the target stays; nothing if the old bundle
    is damaged, which does not say what is its own.
    """
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.name in (_DOCUMENT, _README, _STATEMENT, _WEIGHTS, _PLUGINS, _TARGETS):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.copytree(path, bundle / path.name, symlinks=True)
        else:
            shutil.copy2(path, bundle / path.name, follow_symlinks=False)
    try:
        own = set(_document(folder).files)
    except (ValueError, StoreError):
        return
    for path in sorted((folder / _TARGETS).rglob("*")):
        name = path.relative_to(folder)
        is_other = name.as_posix() not in own and path.is_file() and not path.is_symlink()
        if is_other and (bundle / Path(*name.parts[:2])).is_dir() and not (bundle / name).exists():
            (bundle / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, bundle / name)
