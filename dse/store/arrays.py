"""Records as named arrays in .npz files: what was trained, and what it answered.

A record is a frozen dataclass. Each field is one array of the field's name, except:

    X | None                absent where the field is None
    a record                its own arrays under `<field>/`
    tuple of records        their number as `n_<field>`, the arrays of record k under `<field>/<k>/`
    Mapping of arrays       its arrays under `<field>/`
"""

from __future__ import annotations

import dataclasses
import functools
import json
import lzma
import tokenize
import types
import typing
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from dse.records import Answers, Array, Ints, Layer, Network, Operations, Parameters, Response, Workload
from dse.store.errors import StoreError, check_kind, damaged, unreadable

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Record = TypeVar("Record", bound=DataclassInstance)
else:
    Record = TypeVar("Record")

DAMAGED_ARCHIVE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, NotImplementedError),
    *(OSError, EOFError, ValueError, KeyError),
    *(SyntaxError, tokenize.TokenError),  # of the text of a header
)
"""Everything that reading a damaged .npz file may raise."""

# Fields whose arrays lie elsewhere than under `<field>/`.
_PREFIXES: Mapping[tuple[type, str], str] = {
    (Network, "layers"): "",
    (Layer, "parameters"): "",
    (Parameters, "arrays"): "own/",
}
RECORD = "record.json"
"""The member of a run's archive that is no array."""
_WORK = "work/"
_SCALARS = (bool, int, float, str)
_DTYPES = {bool: np.bool_, int: np.int64, float: np.float64, str: np.str_}


def save_arrays(path: Path, arrays: Mapping[str, Array], *, compressed: bool = True) -> None:
    """Write an .npz."""
    save = np.savez_compressed if compressed else np.savez
    with path.open("wb") as file:
        save(file, **dict(arrays))  # type: ignore[arg-type]


def load_arrays(path: Path, names: Collection[str] | None = None) -> dict[str, Array]:
    """Return the arrays of an .npz; only those among `names`, if given, are read.

    A run of a study is one archive, and its parts have the names of files in it: `run / "weights.npz"` reads
    the arrays of the run under `weights/`.

    Raises:
        Damaged: the file is missing, or not what was written.
        StoreError: it cannot be read now.
    """
    is_part = path.parent.suffix == path.suffix
    file, prefix = (path.parent, f"{path.stem}/") if is_part else (path, "")
    try:
        check_kind(file)
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            found = {x.removeprefix(prefix): x for x in archive.files if x.startswith(prefix) and x != RECORD}
            is_absent = is_part and not found  # or has no arrays
            if is_absent and path.name not in json.loads(archive.zip.read(RECORD))["files"]:
                raise damaged(path, "is missing")
            return {name: archive[x] for name, x in found.items() if names is None or name in names}
    except OSError as error:
        raise unreadable(path, error) from None
    except (*DAMAGED_ARCHIVE, TypeError, AttributeError) as error:
        raise damaged(path, f"cannot be read: {error}") from error


def record_arrays(record: DataclassInstance, prefix: str = "") -> dict[str, Array]:
    """Return a record as named arrays; `record_of` reads them back.

    Args:
        record: a dataclass of arrays, scalars, tuples of scalars, records and tuples of records.
        prefix: precedes every name.

    Raises:
        TypeError: a field is of another type.
    """
    kind = type(record)
    arrays: dict[str, Array] = {}
    for name, hint in _hints(kind).items():
        value = getattr(record, name)
        if value is None:
            continue
        under = prefix + _PREFIXES.get((kind, name), f"{name}/")
        element = _element(hint)
        if dataclasses.is_dataclass(hint):
            arrays |= record_arrays(value, under)
        elif dataclasses.is_dataclass(element):
            arrays[f"{prefix}n_{name}"] = np.array(len(value))
            for k, each in enumerate(value):
                arrays |= record_arrays(each, f"{under}{k}/")
        elif _is_mapping(hint):
            arrays |= {f"{under}{key}": np.asarray(x) for key, x in value.items()}
        elif element is not None:
            arrays[prefix + name] = np.array(value, _DTYPES[element])
        else:
            arrays[prefix + name] = np.asarray(value)
    return arrays


def record_of(kind: type[Record], arrays: Mapping[str, Array], prefix: str = "") -> Record:
    """Return the record of `record_arrays`; further arrays are ignored.

    Args:
        kind: its class.
        arrays: named arrays.
        prefix: precedes every name.

    Raises:
        StoreError: the array of a field without a default is missing.
        TypeError: a field of the class is of a type that cannot be stored.
    """
    optional = _optional(kind)
    values: dict[str, Any] = {}
    for name, hint in _hints(kind).items():
        under = prefix + _PREFIXES.get((kind, name), f"{name}/")
        element = _element(hint)
        if _is_mapping(hint):
            others = {prefix + other for other in _hints(kind)}
            values[name] = {
                key.removeprefix(under): x
                for key, x in arrays.items()
                if key.startswith(under) and key not in others
            }
        elif dataclasses.is_dataclass(hint):
            absent = name in optional and not any(key.startswith(under) for key in arrays)
            values[name] = None if absent else record_of(typing.cast(type[Any], hint), arrays, under)
        elif dataclasses.is_dataclass(element):
            record = typing.cast(type[Any], element)
            n = int(_array(kind, arrays, f"{prefix}n_{name}"))
            values[name] = tuple(record_of(record, arrays, f"{under}{k}/") for k in range(n))
        elif name in optional and prefix + name not in arrays:
            values[name] = None
        elif name in _defaults(kind) and prefix + name not in arrays:
            values[name] = _defaults(kind)[name]
        else:
            array = _array(kind, arrays, prefix + name)
            if element is not None:
                values[name] = tuple(array.tolist())
            else:
                values[name] = array if _is_array(hint) else array.item()
    return kind(**values)


def fitted_of(arrays: Mapping[str, Array]) -> Network | Parameters:
    """Return the trained network or classifier of `record_arrays`.

    Raises:
        StoreError: an array is missing.
    """
    return record_of(Network, arrays) if "n_layers" in arrays else record_of(Parameters, arrays)


def response_arrays(response: Response | Answers, index: Ints) -> dict[str, Array]:
    """Return what a classifier answered as named arrays; `response_of` reads a Response back.

    Args:
        response: the output spikes of a Response are binary: eight of them are stored in a byte.
        index: (n,) sample numbers that were answered.
    """
    arrays = {"index": np.asarray(index), **record_arrays(response)}
    if isinstance(response, Response):
        arrays |= {"shape": np.array(response.output.shape), "output": np.packbits(response.output)}
    return arrays


def response_of(arrays: Mapping[str, Array]) -> Response:
    """Return the response of `response_arrays`.

    Raises:
        StoreError: an array is missing.
    """
    packed = record_of(Response, arrays)
    shape = tuple(_array(Response, arrays, "shape").tolist())
    output = np.unpackbits(packed.output, count=int(np.prod(shape))).reshape(shape)
    return dataclasses.replace(packed, output=output)


def work_arrays(load: Workload | Operations) -> dict[str, Array]:
    """Return a load as named arrays under `work/`; `work_of` reads them back."""
    return record_arrays(load, _WORK)


def work_of(arrays: Mapping[str, Array]) -> Workload | Operations:
    """Return the load of `work_arrays`, from among other arrays.

    Raises:
        StoreError: an array is missing.
    """
    if f"{_WORK}macs" in arrays:
        return record_of(Operations, arrays, _WORK)
    return record_of(Workload, arrays, _WORK)


def _array(kind: type, arrays: Mapping[str, Array], name: str) -> Array:
    if name not in arrays:
        raise StoreError(f"{kind.__name__} needs the array '{name}'")
    return arrays[name]


@functools.cache
def _annotations(kind: type) -> dict[str, Any]:
    """Return the annotation of each field."""
    hints = typing.get_type_hints(kind)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    """Return the type of each field, without `| None`."""
    hints = {name: _present(hint) for name, hint in _annotations(kind).items()}
    for name, hint in hints.items():
        literal = typing.get_origin(hint) is typing.Literal
        if not (
            literal
            or hint in _SCALARS
            or dataclasses.is_dataclass(hint)
            or _is_array(hint)
            or _is_mapping(hint)
            or _element(hint) is not None
        ):
            raise TypeError(f"{kind.__name__}.{name}: {hint} cannot be stored as arrays")
    return hints


@functools.cache
def _optional(kind: type) -> frozenset[str]:
    """Return the names of the fields that may be None."""
    return frozenset(name for name, hint in _annotations(kind).items() if _present(hint) is not hint)


@functools.cache
def _defaults(kind: type) -> Mapping[str, Any]:
    """Return the default of each field that has one."""
    return {x.name: x.default for x in dataclasses.fields(kind) if x.default is not dataclasses.MISSING}


def _present(hint: Any) -> Any:
    """Return X of `X | None`, and any other type as it is."""
    if typing.get_origin(hint) not in (types.UnionType, typing.Union):
        return hint
    options = [option for option in typing.get_args(hint) if option is not types.NoneType]
    return options[0] if len(options) == 1 else hint


def _element(hint: Any) -> Any:
    """Return X of `tuple[X, ...]` where X is a scalar type or a record, else None."""
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is not tuple or len(arguments) != 2 or arguments[1] is not ...:
        return None
    return arguments[0] if arguments[0] in _SCALARS or dataclasses.is_dataclass(arguments[0]) else None


def _is_array(hint: Any) -> bool:
    # The origin of NDArray[...] is ndarray; from NumPy 2.5 on it is the alias NDArray, of such a value.
    alias = typing.get_origin(hint)
    return typing.get_origin(getattr(alias, "__value__", hint)) is np.ndarray


def _is_mapping(hint: Any) -> bool:
    return typing.get_origin(hint) is Mapping
