"""Commands that look up or compute without a study."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from dse.cli.answer import Answer, listing
from dse.cli.signature import Amount, Count, Texts
from dse.config import ConfigError, Fault, known_names
from dse.registry import Rule
from dse.study.question import MOST_DRAWS

_DEFAULT = "loihi1_silicon"


def cost(
    workload: str,
    *,
    hardware: Texts = (),
    contacts_per_hour: Amount = None,
    battery_mwh: Amount = None,
    draws: Annotated[int | None, Rule(low=1, high=MOST_DRAWS)] = None,
) -> Answer:
    """Compute energy, time and cores of an inference on hardware from a workload file, without training.

    Args:
        workload: a YAML or JSON file: layers, n_steps, spikes, ...
        hardware (NAME): a profile's name or file; repeatable (default: loihi1_silicon).
        contacts_per_hour: inferences per hour; adds mean power.
        battery_mwh: battery capacity in mWh; adds battery life.
        draws: sample the profile's uncertain numbers N times.
    """
    from dse.cli import costs

    return costs.costs(workload, hardware or (_DEFAULT,), contacts_per_hour, battery_mwh, draws)


def describe(
    section: str | None = None, name: str | None = None, *, schema: bool = False, markdown: bool = False
) -> Answer:
    """Document the sections, components and keys of search spaces, pages and scenes, with units and ranges.

    Args:
        section: e.g. model.
        name: a component of the section, e.g. snn; of hardware also a YAML file.
        schema: print the JSON Schema of search spaces, for editors.
        markdown: print all of it as one page of Markdown: docs/reference.md.

    Raises:
        ConfigError: the section or component is unknown, or a hardware file has faults.
    """
    from dse.cli import reference

    if schema:
        from dse.config.schema import schema_text

        return Answer([], text=schema_text())
    if markdown:
        from dse.cli.handbook import markdown as page

        return Answer([], text=page().rstrip("\n"))
    if section is None:
        rows = reference.sections()
        return Answer(rows, text=listing([(str(row["section"]), str(row["doc"])) for row in rows]))
    _expect("section", section, (row["section"] for row in reference.sections()))
    known = reference.names(section)
    if name is None and known:
        units = [f" [{row['unit']}]" if section == "columns" and row["unit"] else "" for row in known]
        texts = [(row["name"], row["doc"] + unit) for row, unit in zip(known, units, strict=True)]
        return Answer(known, text=listing(texts))
    if known and not reference.is_file(section, name):
        what = "column" if section == "columns" else section
        _expect(what, str(name), (row["name"] for row in known))
    return Answer(reference.keys(section, name), reference.remarks(section, name), all_rows=True)


def _expect(what: str, name: str, names: Iterable[str]) -> None:
    known = list(names)
    if name not in known:
        raise ConfigError([Fault("dse describe", 0, f"unknown {what} '{name}'; {known_names(name, known)}")])


def simulate(
    scene: str,
    *,
    out: Path | None = None,
    trials: str | None = None,
    set: Texts = (),
    jobs: Count = None,
    figure: Path | None = None,
    trial: str | None = None,
    quiet: bool = False,
) -> Answer:
    """Simulate the trials of a scene; write their events to a file, and one trial as a page.

    Args:
        scene: a YAML file, or the name of a shipped scene.
        out (FILE.npz): write the events of the trials to this file.
        trials (FIRST:END): trials to simulate, from FIRST to END - 1 (default: all).
        set (KEY=VALUE): replace the value of a key, e.g. trials=2 or 'textures=[denim, wool]'; repeatable.
        jobs: trials simulated in parallel (default: one per core).
        figure (PAGE.html): write a page that shows one trial to this file.
        trial (K): the trial that --figure shows (default: the first).
        quiet: print no progress on stderr.

    Returns:
        One row per texture.
    """
    from dse.cli import simulation
    from dse.cli.spaces import overrides_of

    asked = simulation.Asked(scene, overrides_of(set), out, trials, jobs, figure, trial, quiet)
    return simulation.simulate(asked)
