"""The check of targets passes a target that runs, and catches one deliberate mistake each."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from dse.base import registry
from dse.base.registry import param
from dse.deploy.bundle import Bundle
from dse.deploy.reference import Reference
from dse.deploy.targets import Verdict, compare
from dse.testing import check_target
from tests.plugins import with_targets
from tests.plugins.arrays_target import Arrays


@pytest.fixture(autouse=True)
def targets(monkeypatch):
    with_targets.load(monkeypatch)


def test_targets_that_keep_the_contract():
    known = registry.known("targets")
    verdict = check_target(known["arrays"]())
    assert verdict is not None and (verdict.kind, verdict.n_recordings) == ("faithful", 5)
    assert check_target(known["locked"]()) is None
    assert check_target(known["unread"]()) == Verdict("not verified", "no reader is installed")


@dataclass(frozen=True)
class Keyed(Arrays):
    """It has a key."""

    size: int = param(1, doc="size")


@dataclass(frozen=True)
class Random(Arrays):
    """Its files differ from export to export."""

    def write(self, bundle: Bundle, folder: Path) -> None:
        super().write(bundle, folder)
        (folder / "id").write_text(secrets.token_hex(8))


@dataclass(frozen=True)
class Empty(Arrays):
    """It writes nothing."""

    def write(self, bundle: Bundle, folder: Path) -> None:
        """Write nothing."""


@dataclass(frozen=True)
class Claims(Arrays):
    """It never runs what it wrote."""

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        return compare(reference, reference, run_by=["nothing"])


@dataclass(frozen=True)
class Untidy(Arrays):
    """It leaves a log in the bundle."""

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        (folder / "run.log").write_text("done")
        return super().verify(bundle, folder, reference)


@dataclass(frozen=True)
class Boasts(Arrays):
    """It is faithful and says more."""

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        return replace(super().verify(bundle, folder, reference), reason="very faithful")


@dataclass(frozen=True)
class Endless(Arrays):
    """A figure of it is no number."""

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        return replace(super().verify(bundle, folder, reference), figures={"ram_bytes": float("inf")})


@dataclass(frozen=True)
class Nameless(Arrays):
    """Nobody knows what ran it."""

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        return replace(super().verify(bundle, folder, reference), run_by=())


@pytest.mark.parametrize(
    ("target", "text"),
    [
        (Keyed(), "Keyed must have no keys"),
        (Random(), "Random.write must write the same bytes twice"),
        (Empty(), "Empty.write must write files"),
        (Claims(), "Claims.verify must run the files: other weights are faithful"),
        (Untidy(), "Untidy.verify must not change the files"),
        (Boasts(), "Boasts: every verdict but faithful has a reason"),
        (Nameless(), "Nameless.verify must say in run_by what ran the files"),
        (Endless(), "Endless: ram_bytes must be a finite number, got inf"),
    ],
)
def test_broken_targets(target, text):
    with pytest.raises(AssertionError, match=text):
        check_target(target)
