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
import io
import json
import lzma
import math
import tokenize
import types
import typing
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from dse.base.records import Answers, Array, Ints, Layer, Network, Operations, Parameters, Response, Workload
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
        with file.open("rb") as stream, zipfile.ZipFile(stream) as archive:
            members = [x for x in archive.namelist() if x.startswith(prefix) and x != RECORD]
            is_absent = is_part and not members  # or has no arrays
            if is_absent and path.name not in json.loads(archive.read(RECORD))["files"]:
                raise damaged(path, "is missing")
            found = {x.removeprefix(prefix).removesuffix(".npy"): x for x in members}
            return {name: _read(archive, x) for name, x in found.items() if names is None or name in names}
    except OSError as error:
        raise unreadable(path, error) from None
    except (*DAMAGED_ARCHIVE, TypeError, AttributeError) as error:
        raise damaged(path, f"cannot be read: {error}") from error


def _read(archive: zipfile.ZipFile, name: str) -> Array:
    """Return an array of an archive, in half the time of `np.load`, which parses every header anew."""
    with archive.open(name) as member:
        head = member.read(128)
        n = 10 + int.from_bytes(head[8:10], "little")
        if head.startswith(b"\x93NUMPY\x01\x00") and n <= len(head):
            shape, is_fortran, dtype = _layout(head[:n])
            n_bytes = math.prod(shape) * dtype.itemsize
            content = (head[n:] + member.read(max(0, n_bytes + n - len(head))))[:n_bytes]
            if not dtype.hasobject and len(content) == n_bytes:
                member.read(1)  # at its end, whose checksum is looked at
                return np.ndarray(shape, dtype, content, order="F" if is_fortran else "C").copy("K")
    with archive.open(name) as member:  # as rare as what is wrong with it, which numpy says
        return np.asarray(np.lib.format.read_array(member, allow_pickle=False))


@functools.lru_cache(4096)
def _layout(header: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return what the header of an array says: shape, whether columns come first, type."""
    stream = io.BytesIO(header)
    np.lib.format.read_magic(stream)
    return np.lib.format.read_array_header_1_0(stream)


def record_arrays(record: DataclassInstance, prefix: str = "") -> dict[str, Array]:
    """Return a record as named arrays; `record_of` reads them back.

    Args:
        record: a dataclass of arrays, scalars, tuples of scalars, records and tuples of records.
        prefix: precedes every name.

    Raises:
        TypeError: a field is of another type.
    """
    arrays: dict[str, Array] = {}
    for name, field in _fields(type(record)).items():
        value, under = getattr(record, name), prefix + field.prefix
        if value is None:
            continue
        if field.kind == "record":
            arrays |= record_arrays(value, under)
        elif field.kind == "records":
            arrays[f"{prefix}n_{name}"] = np.array(len(value))
            for k, each in enumerate(value):
                arrays |= record_arrays(each, f"{under}{k}/")
        elif field.kind == "mapping":
            arrays |= {f"{under}{key}": np.asarray(x) for key, x in value.items()}
        else:
            arrays[prefix + name] = np.asarray(value, _DTYPES[field.of] if field.kind == "tuple" else None)
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
    fields = _fields(kind)
    values: dict[str, Any] = {}
    for name, field in fields.items():
        under, own = prefix + field.prefix, prefix + name
        if field.kind == "mapping":
            others = {prefix + other for other in fields}
            inside = {key: x for key, x in arrays.items() if key.startswith(under) and key not in others}
            values[name] = {key.removeprefix(under): x for key, x in inside.items()}
        elif field.kind == "record":
            is_absent = field.is_optional and not any(key.startswith(under) for key in arrays)
            values[name] = None if is_absent else record_of(field.of, arrays, under)
        elif field.kind == "records":
            n = int(_array(kind, arrays, f"{prefix}n_{name}"))
            values[name] = tuple(record_of(field.of, arrays, f"{under}{k}/") for k in range(n))
        elif own not in arrays and (field.is_optional or field.default is not dataclasses.MISSING):
            values[name] = None if field.is_optional else field.default
        else:
            array = _array(kind, arrays, own)
            if field.kind == "tuple":
                values[name] = tuple(array.tolist())
            else:
                values[name] = array if field.kind == "array" else array.item()
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


class _Field(NamedTuple):
    """How a field of a record is stored.

    kind: array, scalar, tuple (of scalars), record, records (a tuple of them), or mapping (of arrays).
    of: the class of a scalar, a record, or of the elements of a tuple.
    prefix: of the names of its arrays, where it has several. is_optional: whether it may be None.
    """

    kind: str
    of: Any
    prefix: str
    is_optional: bool
    default: Any


@functools.cache
def _fields(kind: type) -> dict[str, _Field]:
    """Return how each field is stored.

    Raises:
        TypeError: one is of a type that cannot be.
    """
    hints, fields = typing.get_type_hints(kind), {}
    for field in dataclasses.fields(kind):
        hint = hints[field.name]
        options = [x for x in typing.get_args(hint) if x is not types.NoneType]
        is_optional = typing.get_origin(hint) in (types.UnionType, typing.Union) and len(options) == 1
        how, of = _stored(options[0] if is_optional else hint)
        if not how:
            raise TypeError(f"{kind.__name__}.{field.name}: {hint} cannot be stored as arrays")
        prefix = _PREFIXES.get((kind, field.name), f"{field.name}/")
        fields[field.name] = _Field(how, of, prefix, is_optional, field.default)
    return fields


def _stored(hint: Any) -> tuple[str, Any]:
    """Return the kind and the class of a field of a type, as `_Field` has them; '' where there is none."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint in _DTYPES or origin is typing.Literal:
        return "scalar", hint
    if dataclasses.is_dataclass(hint):
        return "record", hint
    if origin is Mapping:
        return "mapping", None
    # The origin of NDArray[...] is ndarray; from NumPy 2.5 on it is the alias NDArray, of such a value.
    if typing.get_origin(getattr(origin, "__value__", hint)) is np.ndarray:
        return "array", None
    if origin is tuple and len(arguments) == 2 and arguments[1] is ...:
        if dataclasses.is_dataclass(arguments[0]):
            return "records", arguments[0]
        return ("tuple", arguments[0]) if arguments[0] in _DTYPES else ("", None)
    return "", None
