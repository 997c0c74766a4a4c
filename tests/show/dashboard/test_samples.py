"""Samples of a reader's own: a file and a serial port are answered in the page as they are outside."""

from types import SimpleNamespace

import numpy as np
import pytest

from dse.config import load_space
from dse.deploy.evaluate import evaluate
from dse.deploy.export import bundle_of
from dse.deploy.targets import emulator
from dse.deploy.targets.wasm import Wasm
from dse.show.dashboard.site import page_server
from dse.show.dashboard.study import write_page
from dse.show.dashboard.touches import gather_touches, machine_of
from dse.show.dashboard.write import write_filled
from dse.study import explore
from tests.deploy.c.test_sketch import RULES, of, streamed, touches
from tests.page_data import held
from tests.serving import served
from tests.show.dashboard.designs import details

WHY = emulator.missing({"ziglang": "cross-compiler", "wasmtime": "run time"})
pytestmark = pytest.mark.skipif(bool(WHY), reason=WHY)

N, N_SENSORS, N_SAMPLES = 30, 3, 40
SPACE = """
study: samples
seed: 3
data: {{kind: time_series, file: touch.npz, step_ms: 10, columns: {{fabric: label}}}}
task: {{target: fabric}}
window: {{n_steps: 16, at: {{choice: [start, middle, contact_onset]}}, onset_threshold: 2}}
split: {{stratified: {{validation: 0.3, test: 0.3}}}}
encoder: {encoder}
model: {{kind: snn, hidden: [8]}}
training: {{epochs: 30, batch_size: 8, learning_rate: 0.03}}
decision: {{phi: [2], theta: [0.5]}}
objectives: [accuracy:max, n_weights:min]
search: {{sampler: grid}}
execution: {{jobs: 1}}
"""
STUDIES = {
    "whole": (1, "{kind: send_on_delta, thresholds: [1, 2]}"),
    "real": (0.7, "{kind: send_on_delta, thresholds: [1, 2]}"),
    "receptors": (0.7, "{kind: receptors}"),
}
"""A unit of the samples, and the encoder."""


def signals(unit):
    """Return recordings (n, sample, sensor) of rest and then contact, and which sensor moves most in each."""
    rng = np.random.default_rng(4)
    label = np.arange(N) % N_SENSORS
    moved = rng.integers(0, 2, (N, N_SAMPLES, N_SENSORS))
    moved[np.arange(N), :, label] *= 3
    rest = rng.integers(2, 8, (N, 1, 1))
    signal = np.cumsum(moved * (np.arange(N_SAMPLES)[:, None] >= rest), axis=1)
    return (unit * (100 + signal)).astype(np.float32), label


@pytest.fixture(scope="module", params=STUDIES)
def study(tmp_path_factory, request):
    folder = tmp_path_factory.mktemp("samples")
    unit, encoder = STUDIES[request.param]
    signal, label = signals(unit)
    np.savez(folder / "touch.npz", signal=signal, label=label)
    (folder / "space.yaml").write_text(SPACE.format(encoder=encoder))
    return explore.run(load_space(folder / "space.yaml"), folder / "results", progress=False)


def rows_of(study):
    """Return a point of each trial, which decides early."""
    return study.points().drop_duplicates("trial", keep="last").to_dict("records")


@pytest.fixture
def playing(study, written, page_path, shown):
    """The page of a study, which plays a point of each trial, opened."""
    if study.folder not in written:
        document = gather_touches(study, rows_of(study))
        assert [design for design in document["designs"].values() if "why" in design] == []
        write_page(study, page_path, plays=False)
        write_filled("page", held(page_path) | {"touches": document}, page_path)
        written[study.folder] = page_path.read_bytes()
    page_path.write_bytes(written[study.folder])
    return shown()


def csv(rows, between=",", head=()):
    return "".join(f"{line}\n" for line in [*head, *(between.join(map(str, row)) for row in rows.tolist())])


def give(page, text, name="touch.csv"):
    """Choose a file."""
    content = text if isinstance(text, bytes) else text.encode()
    page.tab.set_input_files("#touch-file", {"name": name, "mimeType": "text/csv", "buffer": content})


def played(page, name="touch.csv"):
    """Return the label and the time of a file that was chosen, played at once."""
    page.tab.wait_for_function(
        "(name) => document.querySelector('#touch-recording').selectedOptions[0]?.textContent === name"
        " || document.querySelector('.touch small').textContent",
        arg=name,
    )
    assert page.tab.inner_text(".touch small") == ""
    page.tab.click("#touch-end")
    data = page.tab.evaluate("({ ...document.querySelector('.touch').dataset })")
    assert data["recording"] == page.tab.input_value("#touch-recording")
    return int(data["label"]), float(data["time"])


def choose(page, row):
    key = f"{row['trial']}.{row['point']}"
    page.tab.evaluate(f"location.hash = 'chosen={key}'")
    page.tab.wait_for_selector(f"#cards article:first-child[data-key='{key}']")


def complaint(page, text, name="touch.csv"):
    """Return what is said of a file that is not played."""
    page.tab.evaluate("document.querySelector('.touch small').textContent = ''")
    give(page, text, name)
    page.tab.wait_for_function("document.querySelector('.touch small').textContent !== ''")
    return page.tab.inner_text(".touch small").removeprefix(f"{name}: ")


def recordings_of(study):
    file = study.folder.parent.parent / "touch.npz"
    with np.load(file) as arrays:
        return file, arrays["signal"]


def test_a_file_is_answered_in_the_page_as_outside(study, playing):
    file, signal = recordings_of(study)
    page, rows = playing, rows_of(study)
    starts, labels, heading = set(), set(), "left,middle,right"
    for row in rows:
        choose(page, row)
        bundle = bundle_of(study, row)
        found = evaluate(bundle, file)
        for k, between in zip((0, 1, 2, 11, 22), (",", ";", "\t", " ", " ; "), strict=True):
            give(page, csv(signal[k], between, [heading] * (k == 1)), f"{k}.csv")
            assert played(page, f"{k}.csv") == (found.label[k], pytest.approx(found.time_ms[k]))
            labels.add(found.label[k])
        starts.add(bundle.sections.window.at)
    assert starts == {"start", "middle", "contact_onset"} and len(labels) > 1
    drawn = "document.querySelector('.touch canvas').getContext('2d').getImageData(0, 0, 240, 96)"
    assert page.tab.evaluate(f"{drawn}.data.some(Boolean)")
    assert page.violations() == []


@pytest.mark.parametrize("study", ["whole"], indirect=True)
def test_a_file_that_is_dropped_has_a_recording_after_each_blank_line(study, playing):
    file, signal = recordings_of(study)
    page, row = playing, rows_of(study)[0]
    found = evaluate(bundle_of(study, row), file)
    choose(page, row)
    page.tab.evaluate(
        """(text) => {
          const dataTransfer = new DataTransfer();
          dataTransfer.items.add(new File([text], "two.csv"));
          const event = { dataTransfer, bubbles: true, cancelable: true };
          const node = document.querySelector(".touch");
          if (node.dispatchEvent(new DragEvent("dragover", event))) throw new Error("nothing may be dropped");
          node.dispatchEvent(new DragEvent("drop", event));
        }""",
        f"{csv(signal[4])}\r\n \n{csv(signal[5]).rstrip()}",
    )
    assert played(page, "two.csv") == (found.label[4], pytest.approx(found.time_ms[4]))
    page.tab.click("#touch-next")
    assert played(page, "two.csv 2") == (found.label[5], pytest.approx(found.time_ms[5]))
    page.tab.click("#touch-next")
    assert page.tab.input_value("#touch-recording") == "0"
    give(page, csv(signal[6]))
    assert played(page) == (found.label[6], pytest.approx(found.time_ms[6]))
    names = page.tab.locator("#touch-recording option").all_inner_texts()
    assert names[-1] == "touch.csv" and "two.csv" not in names, "another file replaces the last"


@pytest.mark.parametrize("study", ["whole", "real"], indirect=True)
def test_what_is_no_recording_is_said_with_its_line(study, playing):
    _, signal = recordings_of(study)
    page, rows = playing, rows_of(study)
    choose(page, rows[0])
    row = ",".join(map(str, signal[0, 0].tolist()))
    is_whole = bool((signal == np.rint(signal)).all())
    number = "a whole number below 2^24" if is_whole else "a finite number"
    for text, said in {
        "": "no row of numbers found",
        "\n\n  \n": "no row of numbers found",
        "a,b,c\n": "no row of numbers found",
        f"{row}\n{row},1\n": "line 2: 4 values found, 3 expected, one of each sensor",
        f"a,b\n\n{row}\n1\n": "line 4: 1 value found, 3 expected, one of each sensor",
        "1,2,3,,\n": "line 1: 4 values found, 3 expected, one of each sensor",
        f"{row},\n{row}\n1,,2\n": f"line 3: “” found, {number} expected",
        f"{row}\n1,two,3\n": f"line 2: “two” found, {number} expected",
        f"{row}\n1,NaN,3\n": f"line 2: “NaN” found, {number} expected",
        f"{row}\n1,2,Infinity\n": f"line 2: “Infinity” found, {number} expected",
        f"{row}\n1,-1e39,3\n": f"line 2: “-1e39” found, {number} expected",
        f"{row}\n1,2,{'x' * 99}\n": f"line 2: “{'x' * 24}” found, {number} expected",
        bytes(range(256)) * 400: "line 2: ",
        b"\x00" * 200_000: "a line of more than 65\u202f536 characters found, a sample expected",
        f"{row}\n{'1' * 70_000}\n": "a line of more than 65\u202f536 characters found, a sample expected",
        **({f"{row}\n1,2,0.5\n": f"line 2: “0.5” found, {number} expected"} if is_whole else {}),
    }.items():
        found = complaint(page, text)
        assert found == said or (said == "line 2: " and found.startswith(said)), (text[:40], found)
    assert page.tab.is_hidden("#touch-recording")
    give(page, csv(signal[0]))
    played(page)
    kept = page.tab.inner_text(".touch [role=status]")
    assert "found" in complaint(page, "1\n") and page.tab.inner_text(".touch [role=status]") == kept
    assert page.fits() and page.violations() == []


@pytest.mark.parametrize("study", ["whole", "receptors"], indirect=True)
def test_samples_may_end_before_an_answer_and_be_too_many(study, playing):
    _, signal = recordings_of(study)
    page, rows = playing, rows_of(study)
    still = np.repeat(signal[:1, 0], 120_000, axis=0)
    for row in rows:
        choose(page, row)
        is_at_contact = bundle_of(study, row).sections.window.at == "contact_onset"
        give(page, csv(still[:5]))
        page.tab.wait_for_selector(".touch [role=status]:has-text('no')")
        page.tab.click("#touch-end")
        said = page.tab.inner_text(".touch [role=status]")
        assert said.startswith("no contact" if is_at_contact else "no answer: ")
    if is_at_contact:
        assert "100\u202f000 rows" in complaint(page, csv(still))
        page.tab.click("#touch-end")
        assert page.tab.inner_text(".touch [role=status]").startswith("no contact")


PORT = """(text) => {
  Object.assign(window, { answers: [], isAllSent: false, isCancelled: false, isClosed: false });
  const instantiate = WebAssembly.instantiate;
  WebAssembly.instantiate = async (...given) => {
    const { instance } = await instantiate(...given);
    const exports = { ...instance.exports };
    const [name] = Object.keys(exports).filter((one) => one.endsWith("decision"));
    exports[name] = (net) => {
      const label = instance.exports[name](net);
      if (label !== -1) window.answers.push(label);
      return label;
    };
    return { instance: { exports } };
  };
  const bytes = new TextEncoder().encode(text);
  let [at, k] = [0, 0];
  const port = {
    async open({ baudRate }) {
      window.opened = baudRate;
      this.readable = new ReadableStream({
        pull(stream) {
          if (at < bytes.length) stream.enqueue(bytes.slice(at, at += [1, 3, 2, 7, 5, 64][k++ % 6]));
          else window.isAllSent = true;
        },
        cancel() { window.isCancelled = true; },
      });
    },
    async close() {
      if (this.readable.locked) throw new TypeError("the stream is locked");
      window.isClosed = true;
    },
  };
  const serial = { requestPort: async () => port };
  Object.defineProperty(navigator, "serial", { value: serial, configurable: true });
}"""
"""Puts a port in place of the browser's, which sends a text in odd pieces, then waits; keeps all answers."""


def listens(page, text):
    """Let a page listen to a port that sends a text, until it is quiet."""
    page.tab.evaluate(PORT, text)
    page.tab.click("#touch-port")
    page.tab.wait_for_function("window.isAllSent || window.isClosed")
    page.tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


@pytest.fixture
def opened_on(opened):
    """Return a function that opens a page of made-up designs, of which it plays bundles; their keys rise."""

    def open_page(*made, **options):
        designs = {
            f"0.{k}": machine_of(x, Wasm().form(x)) | {"input": "none", "energy": []}
            for k, x in enumerate(made)
        }
        page = opened(
            documents={0: details()},
            parts={"touches": {"designs": designs, "inputs": {"none": []}}},
            **options,
        )
        choose(page, {"trial": 0, "point": 0})
        return page

    return open_page


@pytest.mark.parametrize("rule", RULES)
def test_a_port_is_answered_as_a_stream(rule, opened_on):
    made = of("samples", RULES[rule])
    rows = np.concatenate(touches("samples"))
    answers = [made.answers.index(name) for name in streamed(made, rows)]
    page = opened_on(made)
    listens(page, f"12,3\r\n{csv(rows)}7,7")
    assert (
        len(answers) >= 3
        and page.tab.evaluate("answers") == answers
        and page.tab.evaluate("opened") == 115200
    )
    assert page.tab.get_attribute(".touch", "data-label") == str(answers[-1])
    told = page.tab.inner_text(".touch [role=status]")
    assert told.startswith(made.answers[answers[-1]]) and page.tab.inner_text("#touch-port") == "stop"
    page.tab.click("#touch-port")
    page.tab.wait_for_function("window.isClosed && window.isCancelled")
    assert page.tab.inner_text("#touch-port") == "serial port"
    assert page.tab.inner_text(".touch [role=status]") == told and page.tab.inner_text(".touch small") == ""
    give(page, csv(rows[:40]))
    assert played(page)[0] == answers[0] or RULES[rule]["at"] == "middle"


def test_what_a_port_sends_is_checked_and_another_touch_ends_it(opened_on):
    made = of("samples", RULES["restart"])
    rows = np.concatenate(touches("samples"))
    page = opened_on(made, of("spikes", {}))
    listens(page, f"\n{csv(rows[:30])}1,2,3\n{csv(rows)}")
    page.tab.wait_for_function("window.isClosed")
    assert page.tab.inner_text(".touch small") == "line 32: 3 values found, 4 expected, one of each sensor"
    listens(page, f"\n{csv(rows)}")
    give(page, csv(rows))
    played(page)
    page.tab.wait_for_function("window.isClosed")
    listens(page, f"\n{csv(rows)}")
    choose(page, {"trial": 0, "point": 1})
    page.tab.wait_for_function("window.isClosed")
    page.tab.evaluate(
        "void (navigator.serial.requestPort = () => Promise.reject(new Error('no port was chosen')))"
    )
    choose(page, {"trial": 0, "point": 0})
    page.tab.click("#touch-port")
    page.tab.wait_for_function("document.querySelector('.touch small').textContent === 'no port was chosen'")
    assert page.tab.inner_text("#touch-port") == "serial port"


def test_a_port_is_heard_while_nobody_sees_the_page(opened_on):
    made = of("samples", RULES["restart"])
    rows = np.concatenate(touches("samples"))
    page = opened_on(made)
    page.tab.evaluate("Object.defineProperty(document, 'hidden', { value: true })")
    page.tab.evaluate("window.requestAnimationFrame = () => {}")
    page.tab.evaluate(PORT, f"\n{csv(rows)}")
    page.tab.click("#touch-port")
    page.tab.wait_for_function("window.isAllSent")
    answers = [made.answers.index(name) for name in streamed(made, rows)]
    page.tab.wait_for_function(f"window.answers.length >= {len(answers)}")
    assert page.tab.evaluate("answers") == answers


def test_where_there_is_no_port_or_no_encoder_there_is_no_control(opened_on):
    page = opened_on(of("spikes", {}), of("samples", {}))
    assert page.tab.is_visible("#touch") and not page.tab.is_visible("#touch-port")
    assert "takes spikes" in complaint(page, "1,2\n")
    choose(page, {"trial": 0, "point": 1})
    assert page.tab.is_visible("#touch-port")
    page.tab.evaluate("Object.defineProperty(navigator, 'serial', { value: undefined, configurable: true })")
    choose(page, {"trial": 0, "point": 0})
    choose(page, {"trial": 0, "point": 1})
    assert page.tab.is_visible("text=or your own samples") and not page.tab.is_visible("#touch-port")


@pytest.mark.parametrize("study", ["real"], indirect=True)
def test_a_served_page_takes_samples_too(study, new_tab):
    file, signal = recordings_of(study)
    row = rows_of(study)[1]
    found = evaluate(bundle_of(study, row), file)
    with served(page_server(study.folder, "127.0.0.1", 0)) as server:
        page = SimpleNamespace(tab=new_tab())
        page.tab.goto(f"{server.url}#chosen={row['trial']}.{row['point']}")
        page.tab.wait_for_selector("#touch")
        give(page, csv(signal[3]))
        assert played(page) == (found.label[3], pytest.approx(found.time_ms[3]))
        page.tab.goto("about:blank")
