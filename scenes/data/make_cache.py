"""Write the CSV files of this folder from colour-science (``python scenes/data/make_cache.py``).

Each file has a first column wavelength_nm and a column for each curve; numbers are written so that they read back
to the same float64.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path(__file__).resolve().parent


def tables() -> dict[str, tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Return file name -> (wavelengths in nm, column name -> values) as colour-science holds them."""
    import colour

    def distributions(curves: dict[str, Any]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        first = next(iter(curves.values()))
        grid = np.asarray(first.wavelengths, np.float64)
        for curve in curves.values():
            if not np.array_equal(curve.wavelengths, grid):
                raise SystemExit("curves of one file must share their wavelengths")
        return grid, {name: np.asarray(curve.values, np.float64) for name, curve in curves.items()}

    def cameras(name: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        curves = colour.MSDS_CAMERA_SENSITIVITIES[name]
        values = np.asarray(curves.values, np.float64)
        return np.asarray(curves.wavelengths, np.float64), {str(label): values[:, i] for i, label in enumerate(curves.labels)}

    def observer(name: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        curves = colour.MSDS_CMFS[name]
        values = np.asarray(curves.values, np.float64)
        return np.asarray(curves.wavelengths, np.float64), {label: values[:, i] for i, label in enumerate(("x", "y", "z"))}

    def samples() -> tuple[np.ndarray, dict[str, np.ndarray]]:
        from colour.quality.cfi2017 import load_TCS_CIE2017

        curves = load_TCS_CIE2017(colour.SpectralShape(380, 780, 5))
        values = np.asarray(curves.values, np.float64)
        return np.asarray(curves.wavelengths, np.float64), {f"cie224-{i + 1:02d}": values[:, i] for i in range(values.shape[1])}

    return {
        "cie_1931_2deg.csv": observer("CIE 1931 2 Degree Standard Observer"),
        "cie_224_samples.csv": samples(),
        "babelcolor_average.csv": distributions(dict(colour.SDS_COLOURCHECKERS["BabelColor Average"])),
        "kinoton_75p.csv": distributions({"Kinoton 75P": colour.SDS_LIGHT_SOURCES["Kinoton 75P"]}),
        "cie_d65.csv": distributions({"D65": colour.SDS_ILLUMINANTS["D65"]}),
        "cie_a.csv": distributions({"A": colour.SDS_ILLUMINANTS["A"]}),
        "nikon_5100_npl.csv": cameras("Nikon 5100 (NPL)"),
        "sigma_sd_merrill_npl.csv": cameras("Sigma SDMerill (NPL)"),
    }


def main() -> None:
    """Write all files."""
    for name, (grid, columns) in tables().items():
        with (FOLDER / name).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["wavelength_nm", *columns])
            for i, wavelength in enumerate(grid):
                writer.writerow([repr(float(wavelength)), *(repr(float(values[i])) for values in columns.values())])


if __name__ == "__main__":
    main()
