import gzip
import re

from plotly.offline import get_plotlyjs_version

from dse.config.locate import shipped_folder
from dse.show.dashboard.write import PLOTLY
from tests.page_data import OBJECTIVES, held, points, write_page


def test_the_file_is_whole_and_self_contained(tmp_path):
    path = write_page(
        points(), tmp_path / "new" / "page.html", name="fabric", objectives=list(OBJECTIVES.items())
    )
    text = path.read_text(encoding="utf-8")
    assert [file.name for file in path.parent.iterdir()] == ["page.html"]
    again = write_page(points(), tmp_path / "b.html", name="fabric", objectives=list(OBJECTIVES.items()))
    assert again.read_bytes() == path.read_bytes()
    page = text[: text.index("<body>")] + text[text.index("<body>") : text.index("<script")]
    assert re.findall(r"(?:src|href)=(\S+)", page) == ['"data:,">']
    assert "{{" not in text.replace("{{plotly}}", "").split('<script type="application/gzip"')[0]


def test_hostile_text_stays_data(tmp_path):
    bad = "</script><script>alert(1)</script>{{script}}"
    frame = points(**{"model.kind": bad})
    text = write_page(frame, tmp_path / "page.html", name=bad, objectives=OBJECTIVES).read_text(
        encoding="utf-8"
    )
    assert held(tmp_path / "page.html")["columns"]["model.kind"]["values"][0] == bad
    assert "alert(1)</script>" not in text
    assert text.count("// One state object; every view (views.js) is a function of it") == 1


def test_the_page_draws_with_the_plotly_that_makes_the_figures():
    script = gzip.decompress((shipped_folder("dashboards") / PLOTLY).read_bytes()).decode()
    assert f"plotly.js (strict - minified) v{get_plotlyjs_version()}\n" in script[:200]
