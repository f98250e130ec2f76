"""Tables in Markdown."""

from __future__ import annotations


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table; columns in which nothing stands are left out.

    - `head`: what stands above the columns.
    - `rows`: one line each.
    """
    kept = [k for k in range(len(head)) if k == 0 or any(row[k] for row in rows)]
    lines = [[head[k] for k in kept], ["---"] * len(kept)]
    lines += [[row[k].replace("|", "\\|").replace("\n", " ") for k in kept] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
