"""What several test files share: where the recordings are, and a browser."""

from __future__ import annotations

import functools
import gc
import os
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from dse.base import registry, trust
from dse.config import yaml_lines
from dse.store import book
from dse.study import explore
from dse.study import workers as study_workers
from dse.study.executors.loky import Loky
from tests.in_process import Forked, InProcess
from tests.installed import PAPERS
from tests.waiting import PATIENCE_MS

ROOT = Path(__file__).resolve().parent.parent
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER_FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",  # WebGL without a graphics card
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)

_OF_PAPERS = ("plugins/dse_papers/*", *(f"benchmarks/test_{x}.py" for x in ("hots", "numerics", "papers")))
collect_ignore_glob = [] if PAPERS else list(_OF_PAPERS)

SLOW_FIRST = (
    "test_fpga.py test_execution.py test_pages.py test_printed_spaces.py test_classifier.py",
    "test_contracts.py test_first_hour.py study dashboard cli deploy targets faults",
    "docs snn scene audit executors testing",
)
"""Files and folders of tests/ that take longest: begun last, one would be waited for alone."""

settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("repeatable")

# A shell's background job ignores Ctrl-C, and so would every program that the tests start and stop.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items):
    """Put what takes longest first; within a folder the order stays."""
    place = {name: number for number, name in enumerate(" ".join(SLOW_FIRST).split())}
    last = len(place)
    items.sort(key=lambda item: min(place.get(x, last) for x in (item.path.name, item.path.parent.name)))


def pytest_collection_finish():
    """Leave the thousands of tests, which live as long as the process, out of every collection of garbage."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def no_terminal(monkeypatch):
    """Tables are as wide as in a file: processes of pytest-xdist have the terminal's width in $COLUMNS."""
    monkeypatch.delenv("COLUMNS", raising=False)


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """A cache for the tests of one run; the user's own is never touched."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("DSE_CACHE", str(folder))
        patch.delenv("DSE_CACHE_GIB", raising=False)
        yield folder


@pytest.fixture(scope="session", autouse=True)
def own_config(tmp_path_factory):
    """A list of trusted code for the tests of one run; the user's own is neither read nor written."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("config")
        patch.setenv("DSE_CONFIG", str(folder))
        yield folder


@pytest.fixture
def trusting():
    """Let plugins that files name run; the command line has `--trust` for that."""
    with trust.answering(True):
        yield


@pytest.fixture(autouse=True, scope="session")
def installed():
    """Load what installed distributions register: tests put the registry back as it was before them."""
    for entry in registry._entry_points():
        if entry.name in registry.SECTIONS:
            registry.known(entry.name)


@pytest.fixture(autouse=True, scope="module")
def registered():
    """Plugins that a file's tests load are gone after it: a worker would look for their files."""
    components, plugins = registry._outside(), dict(registry._plugins)
    yield
    registry._replace(components)
    registry._plugins.clear()
    registry._plugins.update(plugins)


@pytest.fixture(autouse=True, scope="session")
def without_sync():
    """Leave files to the system's memory: no test cuts the power."""
    connected = book._connected

    def in_memory(path, mode):
        database = connected(path, mode)
        database.execute("PRAGMA synchronous=OFF")
        return database

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        patch.setattr(book, "_connected", in_memory)
        yield


@pytest.fixture(autouse=True, scope="session")
def texts_once():
    """A text of YAML, most often that of a chip, is taken apart once: it has the same nodes again."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(yaml_lines, "_compose", functools.lru_cache(1000)(yaml_lines._compose))
        yield


@pytest.fixture(autouse=True, scope="module")
def without_workers(request):
    """Studies train in the process of the test, but in files that set WORKERS, and with fixtures below."""
    with pytest.MonkeyPatch.context() as patch:
        if not getattr(request.module, "WORKERS", False):
            patch.setattr(study_workers, "Loky", InProcess)
        yield


@pytest.fixture(autouse=True, scope="session")
def tables_once():
    """A study of a moment writes its tables at its end alone, not with its first trial too."""
    begin = explore._Tables.__init__

    def later(tables, *of):
        begin(tables, *of)
        tables._due += explore._REFRESH_S

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(explore._Tables, "__init__", later)
        yield


@pytest.fixture(autouse=True, scope="module")
def without_pages(request):
    """`dse run` writes no page, which takes a second, but in files that set PAGES."""
    with pytest.MonkeyPatch.context() as patch:
        if not getattr(request.module, "PAGES", False):
            path = "dse.cli.commands.search._page"
            patch.setattr(path, lambda study: f"page: {study.folder / 'page.html'}")
        yield


@pytest.fixture
def workers(monkeypatch):
    """Let the studies of a test train in worker processes."""
    monkeypatch.setattr(study_workers, "Loky", Loky)


@pytest.fixture
def forked(monkeypatch):
    """Let the studies of a test train in forks, which may be killed."""
    monkeypatch.setattr(study_workers, "Loky", Forked)


@pytest.fixture(scope="session")
def torch():
    """PyTorch, which takes seconds to import: every process of the tests would, if that were at the top."""
    return pytest.importorskip("torch", reason="torch is not installed: pip install 'dse-spiking[torch]'")


@pytest.fixture(scope="session")
def shared_data():
    """The folder of public recordings beside the clone; tests that need it are skipped without it."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no recordings: ../shared/data does not exist")
    return folder


@pytest.fixture(scope="session")
def chromium_path():
    """The executable of a Chromium; tests that need it are skipped where there is none."""
    fetched = ROOT / ".venv" / "browser" / "chromium"
    candidates = [os.environ.get("DSE_CHROMIUM"), *map(shutil.which, BROWSERS), fetched]
    path = next((Path(name) for name in candidates if name and Path(name).exists()), None)
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} on PATH, DSE_CHROMIUM is not set")
    return path


@pytest.fixture(scope="session")
def chromium(chromium_path):
    """A headless Chromium driven by playwright."""
    from playwright.sync_api import Error, Page, sync_playwright

    def wait_for_function(tab, expression, *, arg=None):
        """Do as playwright's function, which polls by `eval` in the page, where its policy forbids that."""
        deadline = time.monotonic() + PATIENCE_MS / 1000
        while time.monotonic() < deadline:
            try:
                value = tab.evaluate(expression, arg)
                if value or isinstance(value, list | dict):  # true in the page, also when empty
                    return
            except Error as error:  # the tab is on its way to another page
                if "context was destroyed" not in str(error):
                    raise
            tab.wait_for_timeout(20)
        raise AssertionError(f"waited in vain: {expression}")

    Page.wait_for_function = wait_for_function
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=chromium_path, args=list(BROWSER_FLAGS), timeout=PATIENCE_MS
        )
        yield browser
        browser.close()


def patient(context):
    """Return a browser's context whose tabs wait as long as a busy machine may need."""
    context.set_default_timeout(PATIENCE_MS)
    return context


class WarmTab:
    """A tab that has compiled the drawing library, which takes a new one four times as long as a page.

    A new tab replaces one that a test has closed or that has crashed.
    """

    def __init__(self, browser: Any) -> None:
        self._browser = browser
        self._tab: Any = None

    def get(self) -> Any:
        if self._tab is None:
            self._tab = patient(self._browser.new_context()).new_page()
        return self._tab

    def clear(self) -> None:
        """Empty the tab for the next test; drop a tab that cannot be emptied."""
        from playwright.sync_api import Error

        if self._tab is None:
            return
        try:
            self._tab.goto("about:blank")
        except Error:
            self.close()

    def close(self) -> None:
        if self._tab is not None:
            self._tab.context.close()
        self._tab = None


@pytest.fixture(scope="session")
def page_path(tmp_path_factory):
    """The file of every page that tests open: for another address Chromium compiles the library anew."""
    return tmp_path_factory.mktemp("page") / "page.html"


@pytest.fixture(scope="session")
def warm_tab(chromium):
    """The warm tab of the session."""
    warm = WarmTab(chromium)
    yield warm
    warm.close()


@pytest.fixture
def new_tab(chromium, warm_tab):
    """Return a function that returns an empty tab; the first of a test is warm, each other is new."""
    tabs = []

    def open_tab(size=(1280, 720), scheme="light"):
        tabs.append(patient(chromium.new_context()).new_page() if tabs else warm_tab.get())
        tab = tabs[-1]
        tab.set_viewport_size({"width": size[0], "height": size[1]})
        tab.emulate_media(color_scheme=scheme)
        tab.mouse.move(0, 0)
        return tab

    yield open_tab
    for tab in tabs[1:]:
        tab.context.close()
    warm_tab.clear()
