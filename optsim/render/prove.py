"""Child process: load one libLLVM, ask its version, and render a real 8 x 8 spectral scene with it.

Run as a script, ``prove.py MIN_MAJOR PATH``, never imported: what it tries may kill the process. Prints JSON
lines; the last word on each key counts. An empty PATH proves Mitsuba's scalar variant instead.
"""

import contextlib
import ctypes
import json
import sys


def say(**words: object) -> None:
    """Print one JSON line and flush it, so that it survives a crash in the next step."""
    print(json.dumps(words), flush=True)


def version_of(path: str) -> tuple[int, int, int]:
    """Ask the library itself by ``LLVMGetVersion`` (new in LLVM 16)."""
    library = ctypes.CDLL(path)
    numbers = [ctypes.c_uint() for _ in range(3)]
    library.LLVMGetVersion(*[ctypes.byref(n) for n in numbers])
    major, minor, patch = (n.value for n in numbers)
    return major, minor, patch


def furnace(variant: str) -> None:
    """Render a sphere of albedo 1/2 in a uniform sky and compare with the closed form, 1/2 in every band."""
    import mitsuba as mi
    import numpy as np

    mi.set_variant(variant)
    band = {"type": "regular", "wavelength_min": 500.0, "wavelength_max": 520.0, "values": "0.05,0.05"}
    other = {"type": "regular", "wavelength_min": 600.0, "wavelength_max": 620.0, "values": "0.05,0.05"}
    scene = {
        "type": "scene",
        "sky": {"type": "constant", "radiance": {"type": "uniform", "value": 1.0}},
        "ball": {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.5}}},
        "sensor": {
            "type": "orthographic",
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 3], [0, 0, 0], [0, 1, 0]) @ mi.ScalarTransform4f().scale([0.5, 0.5, 1]),
            "sampler": {"type": "independent", "sample_count": 64},
            "film": {
                "type": "specfilm",
                "width": 8,
                "height": 8,
                "component_format": "float32",
                "rfilter": {"type": "box"},
                "a": band,
                "b": other,
            },
        },
    }
    image = np.array(mi.render(mi.load_dict(scene), integrator=mi.load_dict({"type": "path", "max_depth": 4})))
    value = image.reshape(64, -1).mean(0)
    if value.shape != (2,) or not np.all(np.abs(value / 0.5 - 1) < 0.1):
        say(ok=False, reason=f"the proof scene came out as {value.tolist()} instead of [0.5, 0.5]")
    else:
        say(ok=True)


def main(min_major: int, path: str) -> None:
    """Prove one candidate."""
    with contextlib.suppress(ImportError):  # not on Windows
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if path:
        try:
            version = version_of(path)
        except (OSError, AttributeError) as error:
            old = isinstance(error, AttributeError)
            say(
                ok=False,
                reason=f"older than LLVM 16 (no LLVMGetVersion), {min_major} or newer is needed" if old else f"cannot be loaded: {error}",
            )
            return
        say(version=".".join(map(str, version)))
        if version[0] < min_major:
            say(ok=False, reason=f"LLVM {version[0]} is too old, {min_major} or newer is needed")
            return
    try:
        furnace("llvm_ad_spectral" if path else "scalar_spectral")
    except Exception as error:
        say(ok=False, reason=f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
