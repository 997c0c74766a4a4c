"""A study in memory, as far as a figure's test needs one (`dse.show.figures.Results`)."""

from types import SimpleNamespace

from tests.page_data import OBJECTIVES


def study(points=None, objectives=None, classes=(), chip=None, **files):
    """Return results with a table, and for each file's name without its ending the arrays of every run."""
    return SimpleNamespace(
        points=lambda: points,
        objectives=list((OBJECTIVES if objectives is None else objectives).items()),
        classes=lambda trial: tuple(classes),
        chip=lambda name: chip,
        arrays=lambda trial, name: files.get(name.removesuffix(".npz"), []),
    )
