"""Figures as tables, as JSON, and in the marked sections of a page."""

from __future__ import annotations

import json
import re
from pathlib import Path

from skmotionseg._utils.writing import replacing

from .measuring import machine

MARKED = re.compile(r"(<!-- begin (\w+) -->\n).*?(<!-- end \2 -->)", re.DOTALL)


# ------------------------------------------------------------------------------- cells


def seconds(row):
    """Median of the repeats, and the least and most of them."""
    if "seconds" not in row:
        return ""
    return "{:.3g} ({:.3g}-{:.3g})".format(*row["seconds"])


def number(name, form="{:.1f}"):
    """A cell with one number, empty where the row has none."""

    def cell(row):
        return form.format(row[name]) if row.get(name) is not None else ""

    return cell


def version(row):
    """The version of the package that a row was measured with."""
    return row.get("machine", "").rpartition("skmotionseg ")[2]


def megabytes(row):
    return f"{row['peak'] / 1e6:.0f}" if "peak" in row else ""


# ------------------------------------------------------------------------------ tables


def as_table(rows, columns):
    """Rows as a table that is Markdown, and reads well as it is.

    Parameters
    ----------
    rows : iterable of dict
    columns : dict of str to callable
        Titles, and what makes a row's cell.

    Returns
    -------
    str
    """
    body = [[cell(row) for cell in columns.values()] for row in rows]
    used = [i for i in range(len(columns)) if i == 0 or any(cells[i] for cells in body)]
    lines = [[cells[i] for i in used] for cells in ([*columns], *body)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    lines.insert(1, ["-" * widths[0], *("-" * (w - 1) + ":" for w in widths[1:])])
    return "\n".join(
        "| "
        + " | ".join(
            cell.rjust(width) if i else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        + " |"
        for cells in lines
    )


def show(rows, columns):
    """Print the table, and what it was measured on."""
    print(f"{as_table(rows, columns)}\n\n{machine()}")


# -------------------------------------------------------------------- records and page


def save(path, section, rows):
    """Put rows into a section of a JSON file; those that bear the same name go.

    Parameters
    ----------
    path : path-like or None
        None saves nothing.
    section : str
    rows : iterable of dict
        Each with its name under "row".
    """
    if path is None:
        return
    path = Path(path)
    record = json.loads(path.read_text()) if path.exists() else {}
    kept = {row["row"]: row for row in record.get(section, ())}
    kept |= {row["row"]: {**row, "machine": machine()} for row in rows}
    record[section] = list(kept.values())
    with replacing(path) as file:  # hours of measuring may be in it
        file.write((json.dumps(record, indent=1) + "\n").encode())


def figures(rows, columns):
    """A table and the machine it was measured on, or a word that there is none."""
    if not rows:
        return "(not measured yet)"
    machines = dict.fromkeys(f"Measured on {row['machine']}." for row in rows)
    return "\n\n".join([as_table(rows, columns), *machines])


def write_page(page, record, sections):
    """Rewrite what stands between ``<!-- begin NAME -->`` and ``<!-- end NAME -->``.

    Parameters
    ----------
    page : path-like
    record : path-like
        JSON, as from :func:`save`.
    sections : dict of str to callable
        What makes the text of each section from the record.

    Raises
    ------
    ValueError
        If the page has a section that is not known.
    """
    page, record = Path(page), json.loads(Path(record).read_text())
    text = fill(page.read_text(), record, sections, page)
    with replacing(page) as file:
        file.write(text.encode())


def fill(text, record, sections, page):
    """Text with its marked sections rewritten; see :func:`write_page`."""

    def rewrite(match):
        begin, section, end = match.groups()
        if section not in sections:
            raise ValueError(
                f"{page} has a section {section!r}; known are {sorted(sections)}"
            )
        return f"{begin}{sections[section](record)}\n{end}"

    return MARKED.sub(rewrite, text)
