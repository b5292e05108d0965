"""One self-contained HTML file of headings, words, tables and plots: opens from disk, asks the network for nothing.

    report = Report("Title").heading("Part").text("What it shows.").table(("lane", Column(name="RMS", unit="m")), rows)
    report.plot([Series(name="ins_ekf", x=t_s, y=error_m)], "time, s", "error, m").html()

A lane's name as a series' name gives the lane's own colour; the legend's boxes hide and show curves everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from typing import Final

from server.compare.colours import Ink, inks, slug_of
from server.compare.plots import POINTS, Band, Panel, Series, svg
from server.compare.table import UNKNOWN, Cell, Column, columns_of, is_right

__all__ = ["Band", "Cell", "Column", "Panel", "Report", "Series"]

_TOGGLE: Final = """
document.querySelector('.legend')?.addEventListener('change', (event) => {
  const { value, checked } = event.target;
  const curves = document.querySelectorAll(`[data-of="${CSS.escape(value)}"]`);
  for (const curve of curves) curve.style.display = checked ? '' : 'none';
});
"""


class Report:
    """Parts in the order in which they are added; every method but `html` returns the report itself."""

    def __init__(self, title: str) -> None:
        """Start an empty report."""
        self.title = title
        self._parts: list[str | tuple[tuple[Panel, ...], str, int, float]] = []
        self._contents: list[tuple[str, str]] = []

    def heading(self, text: str) -> Report:
        """Begin a part; it is listed at the top."""
        anchor = f"{slug_of(text)}-{len(self._contents)}"
        self._contents.append((anchor, text))
        self._parts.append(f'<h2 id="{anchor}">{escape(text)}</h2>')
        return self

    def text(self, *paragraphs: str) -> Report:
        """Add paragraphs of plain words."""
        self._parts += [f"<p>{escape(each)}</p>" for each in paragraphs]
        return self

    def table(self, columns: Sequence[Column | str], rows: Iterable[Sequence[Cell]], *, title: str = "") -> Report:
        """Add a table; None and NaN are shown as a dash."""
        self._parts.append(_table(columns_of(columns), [tuple(row) for row in rows], title))
        return self

    def plot(
        self,
        series: Sequence[Series],
        x_label: str,
        y_label: str,
        *,
        title: str = "",
        bands: Sequence[Band] = (),
        equal: bool = False,
        step: bool = False,
        points: int = POINTS,
        height_pt: float = 220.0,
    ) -> Report:
        """Add one plot; see `Panel`."""
        panel = Panel(
            series=series, x_label=x_label, y_label=y_label, bands=bands, equal=equal, step=step, points=points
        )
        return self.panels([panel], title=title, height_pt=height_pt)

    def panels(self, panels: Sequence[Panel], *, title: str = "", columns: int = 1, height_pt: float = 200.0) -> Report:
        """Add several plots as one figure; none are drawn when no panel has a known point."""
        known = tuple(panel for panel in panels if any(len(one.x) for one in panel.series))
        if known:
            self._parts.append((known, title, columns, height_pt))
        return self

    def html(self) -> str:
        """Return the whole file."""
        drawn = [panel for part in self._parts if not isinstance(part, str) for panel in part[0]]
        chosen = inks(one.name for panel in drawn for one in panel.series)
        body = [part if isinstance(part, str) else _figure(chosen, *part) for part in self._parts]
        style = files("server.compare").joinpath("style.css").read_text(encoding="utf-8")
        return "\n".join(
            [
                '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
                '<meta name="viewport" content="width=device-width, initial-scale=1">',
                f"<title>{escape(self.title)}</title>\n<style>\n{style}{_variables(chosen.values())}</style>\n</head>",
                f"<body>\n<main>\n<h1>{escape(self.title)}</h1>",
                _contents(self._contents),
                _legend(chosen),
                *body,
                f"</main>\n<script>{_TOGGLE}</script>\n</body>\n</html>\n",
            ]
        )


def _variables(chosen: Iterable[Ink]) -> str:
    light = "".join(f"--s-{ink.slug}: {ink.light}; " for ink in chosen)
    dark = "".join(f"--s-{ink.slug}: {ink.dark}; " for ink in chosen)
    return f":root {{ {light}}}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark}}} }}\n"


def _contents(entries: Sequence[tuple[str, str]]) -> str:
    links = "".join(f'<a href="#{anchor}">{escape(text)}</a>' for anchor, text in entries)
    return f"<nav>{links}</nav>" if links else ""


def _legend(chosen: dict[str, Ink]) -> str:
    entries = "".join(
        f'<label><input type="checkbox" checked value="{ink.slug}"><svg viewBox="0 0 32 8" aria-hidden="true"><path '
        f'd="M0 4H32" style="stroke: var(--s-{ink.slug}); stroke-width: 3; stroke-dasharray: {_dash(ink)}"/></svg>'
        f"{escape(name)}</label>"
        for name, ink in chosen.items()
    )
    return f'<div class="legend">{entries}</div>' if entries else ""


def _dash(ink: Ink) -> str:
    return " ".join(f"{part:g}" for part in ink.dash) or "none"


def _figure(chosen: dict[str, Ink], panels: tuple[Panel, ...], title: str, columns: int, height_pt: float) -> str:
    drawing = svg(panels, chosen, columns=columns, height_pt=height_pt)
    caption = f"<figcaption>{escape(title)}</figcaption>" if title else ""
    return f"<figure>{caption}{drawing}</figure>"


def _table(columns: Sequence[Column], rows: Sequence[Sequence[Cell]], title: str) -> str:
    kinds = ["n" if is_right(column, [row[k] for row in rows]) else "" for k, column in enumerate(columns)]
    heads = "".join(
        f'<th scope="col" class="{kind}" title="{escape(column.meaning)}">{escape(column.name)}'
        f"{f'<span>{escape(column.unit)}</span>' if column.unit else ''}</th>"
        for column, kind in zip(columns, kinds, strict=True)
    )
    body = "\n".join(f"<tr>{_cells(columns, kinds, row)}</tr>" for row in rows)
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    return (
        f'<div class="scroll"><table>{caption}<thead><tr>{heads}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>'
    )


def _cells(columns: Sequence[Column], kinds: Sequence[str], row: Sequence[Cell]) -> str:
    texts = [column.text(cell) for column, cell in zip(columns, row, strict=True)]
    return "".join(
        f'<td class="{kind}{" u" if text == UNKNOWN else ""}">{escape(text)}</td>'
        for kind, text in zip(kinds, texts, strict=True)
    )
