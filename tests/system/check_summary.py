"""Check the folder that ``optsim run --quick`` leaves: ``python tests/system/check_summary.py DIR``."""

import json
import math
import sys
from pathlib import Path

ROW_KEYS = {
    "target", "sensor", "masks", "R", "shots", "model", "operator", "solver", "tau", "tau_rule",
    "psnr_db", "ssim", "sam_deg", "seconds", "iterations", "stop", "seed",
}  # fmt: skip


def check(folder: Path) -> int:
    summary = json.loads((folder / "summary.json").read_text(), parse_constant=lambda word: sys.exit(f"{word} in summary.json"))
    assert {"version", "config", "machine", "rows"} <= set(summary)
    rows = summary["rows"]
    for row in rows:
        assert set(row) >= ROW_KEYS, sorted(ROW_KEYS - set(row))
        assert math.isfinite(row["psnr_db"]), row
        exact_fit_of_photographs = row["model"] == "physical" and row["solver"] == "basis-pursuit"  # on the page as a warning: unstable
        assert row["psnr_db"] > (0 if exact_fit_of_photographs else 15), row
        assert row["solver"] == "gpsr" or row["converged"] or row["model"] == "physical", row
        assert (row["tau"] is None) == (row["solver"] == "basis-pursuit")
        assert row["shots"] == round(row["R"] * 24 / (1 if row["sensor"] == "mono" else 3))
    found = {(r["sensor"], r["masks"], r["R"], r["model"], r["operator"], r["solver"], r["tau_rule"]) for r in rows}
    for sensor, masks in (("mono", "distinct"), ("mono", "repeated"), ("bayer", "distinct"), ("foveon", "distinct")):
        for ratio in (0.125, 0.5):
            assert (sensor, masks, ratio, "matched", "unit-shift", "basis-pursuit", None) in found
            for rule in ("auto", "oracle"):
                assert (sensor, masks, ratio, "matched", "unit-shift", "gpsr", rule) in found
        for operator in ("unit-shift", "camera"):
            assert (sensor, masks, 0.125, "physical", operator, "basis-pursuit", None) in found
            assert (sensor, masks, 0.125, "physical", operator, "admm", "auto") in found
    page = (folder / "report.html").read_text("utf-8")
    assert "<img" in page
    links = page.replace("http://www.w3.org/", "")
    assert not [word for word in ('src="http', 'href="http', "url(http", "@import") if word in links]
    for figure in ("fig02", "fig03", "fig04", "fig05", "fig07", "fig11", "prism", "tau", "matched", "frames"):
        assert (folder / "figures" / f"{figure}.png").stat().st_size > 5000, figure
        assert (folder / "figures" / f"{figure}.pdf").stat().st_size > 1000, figure
    assert len(list((folder / "frames").glob("*.nc"))) == 12
    assert len(list((folder / "estimates").glob("*.nc"))) == len(rows)
    for name in (f"cubes/{rows[0]['target']}.nc", f"cubes/{rows[0]['target']}.exr"):
        assert (folder / name).stat().st_size > 1000
    return len(rows)


if __name__ == "__main__":
    print(f"{check(Path(sys.argv[1]))} rows of {sys.argv[1]}/summary.json hold what they should")
