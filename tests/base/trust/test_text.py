"""Hostile names of classes and studies act in no text that leaves the program; in data they stay."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

from dse import store
from dse.base import text
from dse.cli import main
from dse.deploy import bundle
from dse.deploy.c.text import strings
from dse.deploy.verify import export_targets
from dse.testing.targets import small_bundle
from tests.command import document
from tests.spaces import write_space

INJECTED = "injected_by_a_label"
LABELS = {
    "spliced end": f"b*\\\n/ int {INJECTED}; /*",
    "newline": f"silk\n#error {INJECTED}\nint {INJECTED};",
    "carriage return": f"silk\r#error {INJECTED}\r",
    "end": f"silk */ int {INJECTED}; /* // wool",
    "nearly ends": "*/*/?*/**//*",
    "trigraphs": f"silk??/\nint {INJECTED}; *??/\n/ wool ??)",
    "line splice at the end": "silk\\",
    "quotes": f'silk", "x"}}; int {INJECTED}; char y[] = {{\'',
    "octal": "silk7\u00007\x018",
    "bidi": "silk\u202e\u2066 wool\u2069\u200f",
    "escape": "silk\x1b]0;title\x07\x1b[31mred\x9b2J",
    "tab and lines": "a\tb\u2028c\u2029d\x85e\x0bf\x0cg",
    "html": "<script>alert(1)</script><img src=x onerror=alert(1)>&amp;",
    "markdown": "[silk](http://x.invalid) ![](x) `code` | cell *b* <b>",
    "template": "$title ${n} {{plotly}} %s TITLE",
    "other scripts": "布 ткань קטיפה 🧵",
    "long": "silk" * 1200,
}
RAW = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")


def named(*labels):
    """Return a bundle with other names of its classes, the first of which is that of its study too."""
    net = small_bundle()
    classes = (*labels, *(f"class {k}" for k in range(len(net.classes))))[: len(net.classes)]
    return dataclasses.replace(
        net, classes=classes, evidence={"study": labels[0]}, record={labels[0]: labels[0]}
    )


@pytest.mark.parametrize("label", LABELS.values(), ids=list(LABELS))
def test_c_holds_no_code_of_a_label_and_its_name(tmp_path, label):
    net = named(label, "wool")
    bundle.write(net, tmp_path / "b")
    export_targets(tmp_path / "b", ["c99"])
    folder = tmp_path / "b" / "targets" / "c99"
    if (compiler := shutil.which("gcc")) is None:
        pytest.importorskip("ziglang", reason="no compiler: pip install 'dse-spiking[targets]'")
    command = [compiler] if compiler else [sys.executable, "-m", "ziglang", "cc"]
    strict = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-I", folder / "src"]
    names = tmp_path / "names.c"
    names.write_text(
        '#include "dse.h"\n#include <stdio.h>\n#include <string.h>\n'
        "int main(void) { int16_t i; for (i = 0; i < (int16_t)DSE_CLASSES; i++) {"
        " const char *x = dse_class_name(i); fwrite(x, 1, strlen(x) + 1, stdout); } return 0; }\n"
    )
    for source, program in ((folder / "main.c", "touch"), (names, "names")):
        built = [*command, *strict, source, folder / "src" / "dse.c", "-o", tmp_path / program]
        done = subprocess.run(built, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert INJECTED.encode() not in (tmp_path / "touch").read_bytes().partition(b".symtab")[2]
    said = subprocess.run([tmp_path / "names"], capture_output=True, check=True).stdout
    expected = [name.partition("\0")[0] for name in net.classes]
    if "\0" not in label:
        assert said == b"".join(name.encode() + b"\0" for name in expected)
    sketch = (folder / "examples" / "touch" / "touch.ino").read_text("utf-8").splitlines()
    assert sketch[0].startswith("// ") and sketch[1].startswith("// ") and sketch[2] == "#include <dse.h>"
    for file in folder.rglob("*"):
        if file.is_file():
            assert not RAW.search(file.read_text("utf-8")), file
    cpp = [compiler or "", "-fpreprocessed", "-dD", "-E", "-P", folder / "src" / "dse.c"]
    if compiler:  # without comments and strings nothing of a label is left
        code = subprocess.run(cpp, capture_output=True, text=True, check=True).stdout
        assert INJECTED not in re.sub(r'"(\\.|[^"\\])*"', '""', code)


def test_names_in_c_are_one_string_or_many_characters():
    assert strings(["a'?", "b"]) == '"a\\047\\077\\0"\n        "b\\0"'
    assert strings(["x" * 5000]).startswith("{\n    'x', 'x',")


@pytest.mark.parametrize("label", LABELS.values(), ids=list(LABELS))
def test_markdown_of_a_bundle_is_one_heading_and_whole_tables(tmp_path, label):
    bundle.write(named(label, "wool"), tmp_path / "b")
    export_targets(tmp_path / "b", ["c99"])
    for path in (tmp_path / "b" / "README.md", tmp_path / "b" / "targets" / "c99" / "README.md"):
        lines = path.read_text("utf-8").split("\n")
        assert lines[0].startswith("# ") and lines[0].endswith("class 0") and lines[1] == ""
        assert not re.search(r"(?<!\\)(\\\\)*[<\[]", lines[0])
        assert not RAW.search("".join(lines))
        widths = [len(re.findall(r"(?<!\\)\|", line)) for line in lines if line.startswith("| ")]
        assert set(widths) <= {3, 5}


@pytest.mark.parametrize("label", LABELS.values(), ids=list(LABELS))
def test_functions_of_text(label):
    one = text.one_line(label)
    assert one.isprintable() or not RAW.search(one)
    assert text.one_line(one) == one
    assert json.loads(text.json_line(json.dumps([label], ensure_ascii=False))) == [label]
    assert not RAW.search(text.json_line(json.dumps([label], ensure_ascii=False)))
    comment = text.c_comment(label)
    assert not any(pair in comment for pair in ("*/", "/*", "??", "\\", "\n", "\r"))
    assert text.lines("a\n\tb" + label).startswith("a\n\tb") and "\x1b" not in text.lines(label)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A folder with a search space on recordings of hostile classes, its study and a bundle."""
    folder = tmp_path_factory.mktemp("labels")
    space = write_space(folder, ("[[1, 2], [1, 2, 4]]", "[[1, 2]]"), ("[4, 8, 12]", "[4]"))
    with np.load(folder / "touch.npz") as arrays:
        content = dict(arrays)
    names = np.array([LABELS["escape"] + LABELS["newline"], LABELS["bidi"] + LABELS["end"]])
    np.savez(
        folder / "touch.npz",
        **{**content, "label": names[np.unique(content["label"], return_inverse=True)[1]]},
    )
    run = ["run", str(space), "--results", str(folder / "results"), "--quiet", "--json"]
    assert main(run) == 0
    assert main(["pick", str(folder / "results" / "tiny"), "--export", str(folder / "bundle"), "--json"]) == 0
    return folder


SHOWN = (
    "check {0}/tiny.yaml",
    "audit {0}/tiny.yaml --format table",
    "skyline {0}/results/tiny --format table",
    "pick {0}/results/tiny",
    "report {0}/results/tiny --format table",
    "evaluate {0}/bundle --data {0}/touch.npz --each --format table",
    "evaluate {0}/bundle --data {0}/touch.npz --format table",
    "evaluate {0}/bundle --data {0}/touch.npz --each --json",
    "init {0}/touch.npz --label label --step-ms 10 --out {0}/first.yaml --force",
    "init {0}/touch.npz --label none --step-ms 10 --out {0}/first.yaml --force",
    "figure {0}/results/tiny {1} --out {0}/x.json",
    "check {0}/{1}.yaml",
    "skyline {0}/results/{1}",
    "doctor {0}/results/{1}",
    "check {0}/tiny.yaml --set study={1}",
    "check {0}/tiny.yaml --set model.kind={1}",
    "evaluate {0}/bundle --data {0}/{1}.npz",
    "check {0}/tiny.yaml --set plugins=[{1}.py]",
    "run {0}/tiny.yaml --results {0}/again",
)


class Terminal(io.StringIO):
    """A terminal that shows what is written to it."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("command", SHOWN)
def test_nothing_acts_in_a_terminal(hostile, monkeypatch, command):
    is_terminal = SHOWN.index(command) % 2 == 0  # every other one is piped
    out, err = (Terminal(), Terminal()) if is_terminal else (io.StringIO(), io.StringIO())
    monkeypatch.setenv("TERM", "dumb")  # our own bold headers are no matter here
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    bad = LABELS["escape"].replace("/", "") + "\u202e"
    main([word.format(hostile, bad) for word in command.split()])
    shown = out.getvalue() + err.getvalue()
    assert shown
    assert not RAW.search(shown.replace("\r\n", "\n")), ascii(shown)


def test_data_keep_their_names(hostile, capsys):
    evaluate = ["evaluate", str(hostile / "bundle"), "--data", str(hostile / "touch.npz"), "--each"]
    names = {LABELS["escape"] + LABELS["newline"], LABELS["bidi"] + LABELS["end"]}
    assert {row["true"] for row in document(capsys, *evaluate)["rows"]} == names
    assert set(bundle.read(hostile / "bundle").classes) == names
    record = store.read_record(store.run_file(hostile / "results" / "tiny", 0, 0))
    assert set(record["classes"]) == names


def test_no_label_is_markup_in_a_page(hostile):
    page = hostile / "page.html"
    assert main(["dashboard", str(hostile / "results" / "tiny"), "--html", str(page)]) == 0
    content = page.read_text("utf-8")
    assert LABELS["html"] not in content and INJECTED not in content.partition("<script")[0]
