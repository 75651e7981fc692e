"""The look of every figure: one palette that colour-blind readers can tell apart, one set of sizes, no global state."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optsim.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette (Color Universal Design, 2008): mono in the two blues, the colour sensors apart from both.
COLORS = {"mono-distinct": "#0072B2", "mono-repeated": "#56B4E9", "bayer": "#009E73", "foveon": "#D55E00"}
MARKERS = {"mono-distinct": "o", "mono-repeated": "v", "bayer": "s", "foveon": "D"}
DASHES: dict[str, str | tuple[int, tuple[int, ...]]] = {"mono-distinct": "-", "mono-repeated": (0, (4, 2)), "bayer": "-", "foveon": "-"}
CHANNELS = {"red": "#C8102E", "green": "#2E8B3D", "blue": "#2456C9", "mono": "#555555"}
INK = "#1b1f24"
MUTED = "#667079"
GRID = "#e3e6e9"
DPI = 180
"""Pixels per inch of the PNG files: about twice what a screen shows at the page's width."""

SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.titleweight": "normal",
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "text.color": INK,
    "text.parse_math": False,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.7,
    "lines.markersize": 5.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "image.interpolation": "nearest",
    "image.resample": False,
}


@dataclass(frozen=True)
class Drawn:
    """Hold one figure that was drawn and written.

    Args:
        name: file stem, e.g. ``fig05``.
        title: what it shows, a few words; begins with the paper's figure number if it redraws one.
        caption: what to see, and the numbers, in sentences.
        alt: what a reader who cannot see the picture needs.
        png, pdf: the files.
    """

    name: str
    title: str
    caption: str
    alt: str
    png: Path
    pdf: Path


@contextmanager
def styled() -> Iterator[None]:
    """Apply the style inside a ``with`` block and leave matplotlib's settings as they were."""
    import matplotlib as mpl

    with mpl.rc_context(SETTINGS):
        yield


def new_figure(width: float, height: float) -> Figure:
    """Make a figure of width x height inches that lays itself out; use inside :func:`styled`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.05, h_pad=0.05, wspace=0.02, hspace=0.03)  # type: ignore[union-attr,call-arg]
    return figure


def save(figure: Figure, directory: Path, name: str) -> tuple[Path, Path]:
    """Write NAME.png and NAME.pdf without dates or versions in them.

    Raises:
        InputError: when the name is not a plain file stem.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_pdf import FigureCanvasPdf

    if not name or not all(c.isascii() and (c.isalnum() or c in "-_") for c in name):
        raise InputError("figure.name", name, "letters, digits, - and _ only")
    directory.mkdir(parents=True, exist_ok=True)
    png, pdf = directory / f"{name}.png", directory / f"{name}.pdf"
    # Printed through the canvases: savefig would draw every figure once more to measure it.
    figure.set_dpi(DPI)
    FigureCanvasAgg(figure).print_png(png, metadata={"Software": None}, pil_kwargs={"compress_level": 4})
    figure.set_layout_engine("none")  # the places are found: don't look for them again
    FigureCanvasPdf(figure).print_pdf(pdf, metadata={"CreationDate": None, "Producer": None, "Creator": None})
    return png, pdf


def picture(axes: Axes, title: str = "", color: str | None = None) -> None:
    """Turn axes into a frame for a picture: no ticks, no grid, a thin border (of a colour)."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(True)
        spine.set_color(color or MUTED)
        spine.set_linewidth(1.4 if color else 0.6)
    if title:
        axes.set_title(title)


def sci(value: float) -> str:
    """Write a small number as 1.26×10⁻³."""
    if value == 0 or 0.01 <= abs(value) < 1000:
        return f"{value:.3g}"
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{mantissa}×10{superscript(int(exponent))}"


def superscript(exponent: int) -> str:
    """Write an integer in superscript digits."""
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def log_ticks(axes: Axes) -> None:
    """Give a logarithmic x axis labels 10⁻⁴ in plain characters (names on a figure are never read as formulas)."""
    import math

    from matplotlib.ticker import FuncFormatter, NullFormatter

    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"10{superscript(round(math.log10(x)))}" if x > 0 else ""))
    axes.xaxis.set_minor_formatter(NullFormatter())


def slug(text: str) -> str:
    """Make a safe file stem from any name: lower-case ASCII letters, digits and dashes."""
    kept = "".join(c if c.isascii() and c.isalnum() else "-" for c in text.lower())
    return "-".join(part for part in kept.split("-") if part)[:40] or "unnamed"
