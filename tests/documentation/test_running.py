import pytest

from scripts.documentation.commands import PageError
from scripts.documentation.pages import PageResult, PageRun
from scripts.documentation.stage import LONGEST, with_results

PAGE = """# A page

```python
value = 20
```

```python
from pathlib import Path

Path("made.txt").write_text("here")
print("printed")
value + 2
```

<!-- exit: 2 -->
```console
$ slidax list nothing-like-that
```
"""


def run(text, folder):
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    (folder / "stand").mkdir(exist_ok=True)
    return list(PageRun(page, folder / "stand", folder / "out").run())


def test_code_blocks_of_a_page_share_variables_and_show_results_like_a_notebook(tmp_path):
    first, second, third = run(PAGE, tmp_path)
    assert first.texts == [""] and second.texts == ["printed\n22\n"]
    assert (tmp_path / "stand" / "made.txt").read_text() == "here"
    assert "nothing-like-that" in third.texts[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Text\n\n```python\n1 / 0\n```\n", r"page\.md, line 3: (.|\n)*ZeroDivisionError"),
        ("```console\n$ slidax list nothing-like-that\n```\n", "exit code 2"),
        ("```console\n$ rm -rf x\n```\n", "`shell` or `not run`"),
        ("```console\n$ slidax --version\nslidax 9.9\n```\n", "the page shows 'slidax 9.9'"),
        ("```python\nprint(1)\n```\n\n<!-- said: above -->\n```text\n2\n```\n", "the page shows '2'"),
        ('<!-- show: nowhere.svg "A picture" -->\n', "no `nowhere.svg`"),
        ("```python\nprint('x' * 2000)\n```\n", r"page\.md, line 1: prints a line of 2000 characters"),
    ],
)
def test_a_failing_code_block_is_an_error_with_its_reason(text, message, tmp_path):
    with pytest.raises(PageError, match=message):
        run(text, tmp_path)


def test_marked_blocks_are_skipped_with_their_reason(tmp_path):
    robot = "<!-- not run: it needs a robot -->\n```sh\nrobot --go\n```\n\n"
    missing = "<!-- needs: no_such_package -->\n```python\n1/0\n```\n"
    assert [item.skipped for item in run(robot + missing, tmp_path)] == ["it needs a robot", "no_such_package not here"]


def test_shell_blocks_run_in_bash_with_slidax(tmp_path):
    (item,) = run("<!-- shell: bash -->\n```sh\necho first\nslidax --version | tr a-z A-Z\n```\n", tmp_path)
    assert item.texts[0].startswith("first\nSLIDAX ")


def test_figures_of_code_blocks_are_saved_as_svg_files(tmp_path):
    text = "```python\nimport matplotlib.pyplot as plt\nfigure, _ = plt.subplots()\nfigure\n```\n"
    (item,) = run(text, tmp_path)
    assert (tmp_path / "out" / item.figures[0]).read_text(encoding="utf-8").lstrip().startswith("<?xml")


def test_results_are_shown_as_text_below_their_blocks():
    text = "# T\n\n```python\nprint('<b>')\n```\n\nEnd\n"
    outcome = {"index": 0, "texts": ["<b> & 1\n\n2\n"], "figures": ["t-0.svg"], "skipped": "", "seconds": 0.0}
    shown = with_results(text, "tutorials/t.md", PageResult([outcome], []))
    assert "&lt;b&gt; &amp; 1\n&#8203;\n2" in shown
    assert shown.index("print(") < shown.index("&lt;b&gt;") < shown.index("](made/t-0.svg)") < shown.index("End")
    assert "&lt;b&gt;" not in with_results(text, "robots.md", PageResult([outcome], []))
    quoted = text.replace("End", "<!-- said: above -->\n```text\n<b> & 1\n```\n\nEnd")
    empty = {**outcome, "index": 1, "texts": [], "figures": []}
    assert "&lt;b&gt;" not in with_results(quoted, "tutorials/t.md", PageResult([outcome, empty], []))
    long = {**outcome, "texts": ["\n".join(str(k) for k in range(LONGEST + 10))]}
    assert f"<summary>{LONGEST // 2 + 10} more lines</summary>" in with_results(
        text, "tutorials/t.md", PageResult([long], [])
    )
