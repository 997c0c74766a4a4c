"""A study, a bundle and other files of somebody else, whose code leaves a trace when it runs."""

from __future__ import annotations

import contextlib
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import pandas
import yaml

from dse import store
from dse.base import registry
from dse.cli import main
from dse.deploy.bundle import sealed
from tests.spaces import write_space

PLUGIN = '''
from dataclasses import dataclass
from pathlib import Path

from dse.data.encoders.send_on_delta import SendOnDelta
from dse.measure.objectives import Points
from dse.base.registry import Column, register

Path({trace!r}).write_text("the code of others ran")


@register("encoders", "encoder_of_others")
@dataclass(frozen=True)
class OfOthers(SendOnDelta):
    """An encoder of a plugin."""


@register("objectives", "worth_of_others")
@dataclass(frozen=True)
class Worth:
    """An objective of a plugin."""

    needs = "points"
    columns = (Column("worth_of_others", "", "max", "What it is worth."),)

    def measure(self, points: Points) -> dict[str, object]:
        return {{"worth_of_others": points.accuracy / 2}}
'''
CHANGES = (
    ("seed: 3\n", "seed: 3\nplugins: [mine.py]\n"),
    ("send_on_delta", "encoder_of_others"),
    ("[[1, 2], [1, 2, 4]]", "[[1, 2]]"),
    ("[4, 8, 12]", "[4, 8]"),
    ("[accuracy:max, n_weights:min]", "[accuracy:max, worth_of_others:max, n_weights:min]"),
)


@dataclass(frozen=True)
class Others:
    """root: folder of all. space: a search space with a plugin beside it. study: its results. bundle: a pick.

    trace: the file that the code of the plugin writes.
    """

    root: Path
    trace: Path

    @property
    def space(self) -> Path:
        return self.root / "tiny.yaml"

    @property
    def study(self) -> Path:
        return self.root / "results" / "tiny"

    @property
    def bundle(self) -> Path:
        return self.root / "bundle"

    @property
    def data(self) -> Path:
        return self.root / "touch.npz"

    def rows(self) -> list[dict[str, object]]:
        """Return the design points of the study."""
        return pandas.read_parquet(self.study / "points.parquet").to_dict("records")

    def copied(self, to: Path) -> Others:
        """Return a copy whose plugin is that of the original."""
        shutil.copytree(self.root, to)
        return Others(to, self.trace)

    def rename_plugins(self, *names: str) -> None:
        """Write other plugins into the search space of the study, with a seal that agrees."""
        path = self.study / "search_space.yaml"
        space = yaml.safe_load(store.read_text(path))
        store.write_text(path, yaml.safe_dump({**space, "plugins": list(names)}, sort_keys=False))


@contextlib.contextmanager
def forgotten():
    """Let this process be one that has loaded no plugin yet."""
    before, plugins = registry._outside(), dict(registry._plugins)
    registry._replace({pair: cls for pair, cls in before.items() if "dse_plugin_" not in cls.__module__})
    registry._plugins.clear()
    registry.left_out()
    try:
        yield
    finally:
        registry._replace(before)
        registry._plugins.clear()
        registry._plugins.update(plugins)


def made(root, trace):
    """Return what somebody has trained, picked and exported on a machine that trusts its own plugin."""
    root.mkdir()
    others = Others(root, trace)
    (root / "mine.py").write_text(PLUGIN.format(trace=str(trace)))
    write_space(root, *CHANGES)
    with forgotten():
        run = ["run", str(others.space), "--results", str(root / "results"), "--quiet", "--json", "--trust"]
        assert main(run) == 0
        assert trace.exists()
        assert main(["pick", str(others.study), "--export", str(others.bundle), "--target", "c99"]) == 0
    trace.unlink()
    return others


def poisoned(bundle, file, more):
    """Append a text to a file of a bundle, with checksums that agree."""
    path = bundle / file
    path.write_text(path.read_text(encoding="utf-8") + more, encoding="utf-8")
    document = json.loads((bundle / "bundle.json").read_text())
    document["files"][file] = store.checksum(path)
    (bundle / "bundle.json").write_text(json.dumps(sealed(document)))
