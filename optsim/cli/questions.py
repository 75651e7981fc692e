"""Verbs that answer a question: doctor, scenes, show."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from optsim.cli.words import Json, print_json
from optsim.errors import InputError


def doctor(*, json: Json = False) -> None:
    """Check this machine by rendering a real scene in a child process: backend, LLVM, cores, memory, versions."""
    from optsim.render.backend import doctor as examine

    report: dict[str, Any] = examine()
    if json:
        print_json(report)
    else:
        print(f"variant       {report['variant']}")
        print(f"render        {'works' if report['render_ok'] else 'FAILS'}")
        print(f"LLVM          {report['llvm_version'] or 'none'}   {report['llvm_path'] or ''}")
        print(f"cores         {report['cores']}")
        print(f"memory        {report['memory_gib']:.1f} GiB")
        for name, version in report["versions"].items():
            print(f"{name:13s} {version}")
        for name in sorted(set(report) - {"variant", "render_ok", "llvm_path", "llvm_version", "cores", "memory_gib", "versions"}):
            print(f"{name:13s} {report[name]}")
    if not report["render_ok"]:
        raise SystemExit(1)


def scenes(*, json: Json = False) -> None:
    """List what can be rendered."""
    from scenes import SCENES

    entries: dict[str, str] = {recipe.name: recipe.build().description for recipe in SCENES}
    if json:
        print_json(entries)
        return
    for name, description in entries.items():
        print(f"{name:22s} {description}")


def show(
    file: Annotated[Path, Parameter(help="Cube, frames or estimate.")],
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"], help="PNG to write; FILE with .png when absent.")] = None,
    points_from: Annotated[
        Path | None, Parameter(help="A cube of the same size, the truth say: show FILE at its points, in its exposure and white.")
    ] = None,
) -> None:
    """Draw a cube, frames or an estimate: sRGB, a few bands, spectra of points; as a PNG."""
    from optsim.files import read
    from optsim.report.show import show as draw

    target = file.with_suffix(".png") if output is None else output
    if target.suffix != ".png":
        raise InputError("-o", str(target), "a file path that ends in .png")
    draw(read(file), target, like=None if points_from is None else read(points_from))
    print(target)
