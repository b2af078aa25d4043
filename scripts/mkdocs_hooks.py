"""Hooks of MkDocs for the documentation site: see ``hooks`` in ``mkdocs.yml``.

- Pages of ``docs/tutorials`` are notebooks in Jupytext's Markdown format. They are executed when
  the site is built, and their outputs become part of the page. A cell that fails stops the build.
- README, CHANGELOG and CONTRIBUTING become pages. Files of ``results/`` that a page shows are
  copied.
- A page that would fetch anything from another host stops the build.
"""

import os
import re
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

import jupytext
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbclient import NotebookClient
from nbformat import NotebookNode

ROOT = Path(__file__).parents[1]
#: Pages that are files of the repository's root, and their names on the site.
ROOT_PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
}
#: Files of the root that these pages link to.
ROOT_FILES = ("CITATION.cff", "LICENSE")
#: Time limit of a cell [s].
CELL_TIME = 180
#: Without it, Jupytext assumes the language of most cells for the notebook.
_KERNEL = """---
jupyter:
  kernelspec:
    display_name: Python 3
    language: python
    name: python3
---

"""
_IMAGES = {"image/png": "png", "image/gif": "gif"}
_STYLE = re.compile(r"<style.*?</style>\s*", re.DOTALL)
_FRAME = '<table border="1" class="dataframe">'
_RESULT = re.compile(r"\]\((?:\.\./)*(results/[^)\s#]+)\)")
_LINK = re.compile(r"\]\(([^)\s#:]+)(#[^)\s]*)?\)")
#: Addresses that a browser fetches by itself, unlike links that a reader clicks.
_FETCHED = re.compile(
    r"""<(?:script|img|iframe|source|video)\b[^>]*\ssrc=["']?((?:https?:)?//[^"'\s>]+)"""
    r"""|<link\b(?=[^>]*rel=["']?(?:stylesheet|icon|preload|preconnect))[^>]*href=["']?((?:https?:)?//[^"'\s>]+)"""
    r"""|(?:@import|url\()\s*["']?((?:https?:)?//[^"')\s]+)"""
)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the root, notebooks for download, and the results that pages show."""
    for source, name in ROOT_PAGES.items():
        text = _moved((ROOT / source).read_text(encoding="utf-8"))
        files.append(File.generated(config, name, content=text))
    for name in ROOT_FILES:
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    texts = [file.content_string for file in files.documentation_pages()]
    for path in sorted({path for text in texts for path in _RESULT.findall(text)}):
        path = unquote(path)  # labels of scenarios may have spaces
        files.append(File.generated(config, path, abs_src_path=str(ROOT / path)))
    for page in _tutorials(files):
        notebook = jupytext.reads(_KERNEL + page.content_string, fmt="md")
        name = str(PurePosixPath(page.src_uri).with_suffix(".ipynb"))
        content = jupytext.writes(notebook, fmt="ipynb")
        files.append(File.generated(config, name, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, files: Files, **_: Any) -> str:
    """Run a tutorial and add its outputs; make links to results point to the site's copies."""
    if page.file in _tutorials(files):
        markdown = _executed(markdown, page.file.src_uri)
    above = "../" * page.file.src_uri.count("/")
    return _RESULT.sub(rf"]({above}\1)", markdown)


def on_post_build(config: MkDocsConfig) -> None:
    """Refuse a site that fetches anything from elsewhere.

    Raises:
        PluginError: with a message that names the page and the address.
    """
    for path in sorted(Path(config.site_dir).rglob("*")):
        if path.suffix not in (".html", ".css"):
            continue
        for found in _FETCHED.finditer(path.read_text(encoding="utf-8")):
            address = next(filter(None, found.groups()))
            raise PluginError(f"{path} fetches {address}: the site has to work without a network")


def _moved(text: str) -> str:
    """The text of a page of the root, with links relative to ``docs``."""

    def link(found: re.Match[str]) -> str:
        path, anchor = found[1], found[2] or ""
        return f"]({ROOT_PAGES.get(path, path.removeprefix('docs/'))}{anchor})"

    return _LINK.sub(link, text)


def _tutorials(files: Files) -> list[File]:
    pages = files.documentation_pages()
    return [p for p in pages if p.src_uri.startswith("tutorials/") and p.name != "index"]


def _executed(text: str, name: str) -> str:
    """A notebook as Markdown, with the outputs of its cells.

    Standard error, such as progress bars, is left out.
    """
    notebook = jupytext.reads(_KERNEL + text, fmt="md")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(
            notebook,
            timeout=CELL_TIME,
            kernel_name="python3",
            resources={"metadata": {"path": folder}},
            extra_arguments=["--IPKernelApp.log_level=ERROR"],
        )
        client.execute(env={**os.environ, "PATH": path})
    link = f"*This page is a notebook: [download it]({PurePosixPath(name).stem}.ipynb).*"
    return "\n\n".join([*map(_cell, notebook.cells), link])


def _cell(cell: NotebookNode) -> str:
    if cell.cell_type != "code":
        return str(cell.source)
    source, language = cell.source, "python"
    if source.startswith("%%sh\n"):
        source, language = source.removeprefix("%%sh\n"), "sh"
    source = source.replace("%%writefile ", "# ", 1)
    printed = "".join(
        output.text
        for output in cell.outputs
        if output.output_type == "stream" and output.name == "stdout"
    )
    shown = [_shown(output.data) for output in cell.outputs if output.output_type != "stream"]
    parts = [f"```{language}\n{source}\n```"]
    if printed:
        parts.append(f"```text\n{printed.rstrip()}\n```")
    return "\n\n".join([*parts, *shown])


def _shown(data: Mapping[str, str]) -> str:
    """The result of a cell, in the richest form that it offers."""
    for kind, suffix in _IMAGES.items():
        if kind in data:
            encoded = "".join(data[kind].split())
            return f"![Output](data:image/{suffix};base64,{encoded})"
    if "text/html" in data:  # a data frame, in the site's own style
        return _STYLE.sub("", data["text/html"]).replace(_FRAME, "<table>")
    return f"```text\n{data['text/plain']}\n```"
