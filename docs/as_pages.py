"""Pages that are not Markdown in docs/: the results, and the notebooks with what each cell has shown."""

import json
import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parent.parent


def on_files(files, config):
    """Put a page in the place of each notebook, and the results with their pictures beside the documents."""
    for path in sorted(x for end in ("md", "png") for x in (ROOT / "results").rglob(f"*.{end}")):
        files.append(File(str(path.relative_to(ROOT)), str(ROOT), config.site_dir, use_directory_urls=True))
    for file in [x for x in files if x.src_uri.endswith(".ipynb")]:
        files.remove(file)
        place = file.src_uri.replace(".ipynb", ".md")
        files.append(File.generated(config, place, content=page(json.loads(file.content_string))))
    return files


def on_page_markdown(markdown, page, **_):
    """Let links to notebooks and between documents and results lead to their pages."""
    if page.file.src_uri.startswith("results/"):
        return markdown.replace("](../docs/", "](../")
    markdown = markdown.replace("](../results/", "](results/")
    return re.sub(r"\]\((notebooks/\w+)\.ipynb\)", r"](\1.md)", markdown)


def page(notebook):
    """Return a notebook as Markdown."""
    parts = []
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        parts += map(shown, cell.get("outputs", ()))
    return "\n\n".join(parts)


def shown(output):
    """Return an output of a cell as Markdown."""
    data = output.get("data", {"text/plain": output.get("text")})
    forms = {kind: "".join(text) for kind, text in data.items()}
    if "image/png" in forms:
        return f'<img alt="the figure" src="data:image/png;base64,{forms["image/png"]}">'
    return forms.get("text/html") or f"```text\n{forms['text/plain'].rstrip()}\n```"
