"""Find a libLLVM that Dr.Jit can live with, and hand it over before Dr.Jit is first imported.

Dr.Jit compiles its kernels with whatever libLLVM it finds. One that is too old is accepted and then aborts the
whole process in the middle of a render (docs/decisions/0002-llvm.md), so a library is used here only when it is
the pinned wheel's own, or when a child process has rendered a real spectral scene with it. This module imports
neither Dr.Jit nor Mitsuba.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

VARIABLE = "DRJIT_LIBLLVM_PATH"
MIN_MAJOR = 17
PINNED_WHEEL, PINNED_VERSION = "karellen-llvm-core", "23.1.4.post8"
PROOF_TIMEOUT_S = 180.0
_NAME = re.compile(r"^(libLLVM(-?\d[\d.]*)?(\.so(\.[\d.]+)?|\.dylib)|LLVM-C\.dll)$")
_SYSTEM_GLOBS = (
    "/usr/lib/llvm-*/lib/libLLVM*",
    "/usr/lib/*-linux-gnu/libLLVM*",
    "/usr/lib64/libLLVM*",
    "/usr/lib64/llvm*/lib*/libLLVM*",
    "/usr/lib/libLLVM*",
    "/usr/local/lib/libLLVM*",
    "/opt/homebrew/opt/llvm*/lib/libLLVM*",
    "/usr/local/opt/llvm*/lib/libLLVM*",
)


@dataclass(frozen=True)
class Refusal:
    """Say why a libLLVM is not used."""

    path: str
    reason: str


@dataclass(frozen=True)
class LlvmReport:
    """Say which libLLVM Dr.Jit was given, how it was proven, and which ones were refused.

    ``path`` and ``version`` are None when no usable library was found.
    """

    path: str | None
    version: str | None
    proof: str
    refused: tuple[Refusal, ...] = ()

    @property
    def usable(self) -> bool:
        """Tell whether there is a library to compile kernels with."""
        return self.path is not None


_chosen: LlvmReport | None = None


def use_llvm() -> LlvmReport:
    """Choose a libLLVM once per process and set ``DRJIT_LIBLLVM_PATH`` to it, without importing Dr.Jit.

    Call it before the first import of drjit or mitsuba. Order: ``DRJIT_LIBLLVM_PATH``, the pinned wheel, the
    system's libraries, newest first. Never raises for a bad library: it is listed in ``refused``.
    """
    global _chosen
    if _chosen is None:
        _chosen = _already_loaded() or choose()
        if _chosen.path is not None and os.path.exists(_chosen.path):
            os.environ[VARIABLE] = _chosen.path
    return _chosen


def _already_loaded() -> LlvmReport | None:
    """Report on the libLLVM that Dr.Jit bound itself to if someone imported it first; None if nobody did."""
    drjit = sys.modules.get("drjit")
    if drjit is None:
        return None
    numbers = drjit.detail.llvm_version()
    version = ".".join(map(str, numbers))
    path = os.environ.get(VARIABLE)
    if numbers[0] >= MIN_MAJOR:
        return LlvmReport(path or "found by Dr.Jit itself", version, "loaded by Dr.Jit before optsim could choose; its version is checked")
    reason = f"Dr.Jit was imported before optsim and loaded LLVM {version}, {MIN_MAJOR} or newer is needed: import optsim.render first"
    return LlvmReport(None, None, f"no libLLVM of version {MIN_MAJOR} or newer", (Refusal(path or "found by Dr.Jit itself", reason),))


def choose(always_prove: bool = False) -> LlvmReport:
    """Walk the candidates and return a report on the first usable one, leaving the environment alone.

    Args:
        always_prove: render in a child process even if the library is the pinned wheel's or was proven before.
    """
    refused: list[Refusal] = []
    given = os.environ.get(VARIABLE)
    for path in candidates():
        version = None if always_prove else _pinned_version(path)
        if version is not None:
            return LlvmReport(str(path), version, f"trusted: {PINNED_WHEEL} {PINNED_VERSION}, the pinned wheel", tuple(refused))
        verdict = prove(path, use_cache=not always_prove)
        if verdict["ok"]:
            how = (
                "proven earlier by a child process" if verdict.get("cached") else "proven by a child process that rendered a spectral scene"
            )
            return LlvmReport(str(path), str(verdict["version"]), how, tuple(refused))
        refused.append(Refusal(str(path), str(verdict["reason"])))
        if given is not None and str(path) == given:
            warnings.warn(f"{VARIABLE}={given} is not used: {verdict['reason']}", stacklevel=2)
    return LlvmReport(None, None, f"no libLLVM of version {MIN_MAJOR} or newer", tuple(refused))


def candidates() -> list[Path]:
    """List libLLVM files in order of preference, each real file once."""
    seen: set[str] = set()
    found: list[Path] = []
    for path in [*_from_environment(), *_from_wheel(), *_from_system()]:
        real = os.path.realpath(path)
        if real not in seen:
            seen.add(real)
            found.append(path)
    return found


def _from_environment() -> Iterator[Path]:
    given = os.environ.get(VARIABLE)
    if given:
        yield Path(given)


def _from_wheel() -> Iterator[Path]:
    """Yield the pinned wheel's library: by its file list, else by its place in the environment.

    The wheel makes the plain ``libLLVM.so`` link when Python first starts after the installation; the versioned
    file is there at once, and serves as well.
    """
    paths: list[Path] = []
    try:
        dist = importlib.metadata.distribution(PINNED_WHEEL)
        paths = [Path(str(dist.locate_file(f))).resolve() for f in dist.files or () if _NAME.match(f.name)]
    except importlib.metadata.PackageNotFoundError:
        pass
    paths += [p for p in Path(sys.prefix, "lib").glob("libLLVM*") if _NAME.match(p.name)]
    yield from (p for p in paths if p.is_file())


def _from_system() -> list[Path]:
    paths = {p for pattern in _SYSTEM_GLOBS for p in Path("/").glob(pattern.lstrip("/")) if _NAME.match(p.name) and p.is_file()}
    paths |= set(_from_loader())
    return sorted(paths, key=lambda p: (_numbers(os.path.realpath(p)), str(p)), reverse=True)


def _from_loader() -> Iterator[Path]:
    """Yield what the dynamic loader knows: ldconfig's cache on Linux, the search path elsewhere."""
    if sys.platform.startswith("linux"):
        for tool in ("/sbin/ldconfig", "/usr/sbin/ldconfig"):
            if os.access(tool, os.X_OK):
                listing = subprocess.run([tool, "-p"], capture_output=True, text=True, check=False).stdout
                for path in re.findall(r"=> (\S*libLLVM\S*)", listing):
                    if _NAME.match(Path(path).name) and Path(path).is_file():
                        yield Path(path)
                return
        return
    import ctypes.util

    name = ctypes.util.find_library("LLVM") or ctypes.util.find_library("LLVM-C")
    if name and Path(name).is_file():
        yield Path(name)


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(n) for n in re.findall(r"\d+", text))


def _pinned_version(path: Path) -> str | None:
    """Return the LLVM version if ``path`` is the library of the wheel this release was tested with, else None."""
    try:
        dist = importlib.metadata.distribution(PINNED_WHEEL)
    except importlib.metadata.PackageNotFoundError:
        return None
    if dist.version != PINNED_VERSION:
        return None
    own = {os.path.realpath(str(dist.locate_file(f))) for f in dist.files or () if _NAME.match(f.name)}
    return PINNED_VERSION.split(".post")[0] if os.path.realpath(path) in own else None


def prove(path: Path | None, use_cache: bool = True) -> dict[str, object]:
    """Render an 8 x 8 spectral scene in a child process with this libLLVM (None: in Mitsuba's scalar variant).

    A crash of the child is a verdict like any other. Verdicts are kept in the user's cache directory under the
    file's path, size and date and the versions of Dr.Jit and Mitsuba; a time-out is not kept.

    Returns:
        ``{"ok": bool, "version": str | None, "reason": str, "cached": bool}``.
    """
    key = _proof_key(path)
    if key is not None and use_cache:
        kept = _read_proofs().get(key)
        if isinstance(kept, dict) and isinstance(kept.get("ok"), bool):
            return {"version": None, "reason": "", **kept, "cached": True}
    child = Path(__file__).with_name("render") / "prove.py"
    command = [sys.executable, "-P", str(child), str(MIN_MAJOR), "" if path is None else str(path)]
    environment = {**os.environ, VARIABLE: "" if path is None else str(path)}
    try:
        run = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=PROOF_TIMEOUT_S, env=environment, check=False
        )
    except subprocess.TimeoutExpired:
        return {"ok": False, "version": None, "reason": f"the proof render did not end within {PROOF_TIMEOUT_S:g} s", "cached": False}
    except OSError as error:
        return {"ok": False, "version": None, "reason": f"the proof render did not start: {error}", "cached": False}
    verdict = _verdict(run)
    if key is not None:
        _write_proof(key, verdict)
    return {**verdict, "cached": False}


def _verdict(run: subprocess.CompletedProcess[str]) -> dict[str, object]:
    """Read the child's JSON lines; a child that died speaks through its signal and its last words."""
    told: dict[str, object] = {"ok": False, "version": None, "reason": ""}
    for line in run.stdout.splitlines():
        try:
            told.update(json.loads(line))
        except ValueError:
            continue
    if not told["ok"] and not told["reason"]:
        last = run.stderr.strip().splitlines()[-1:] or ["no message"]
        end = f"signal {-run.returncode}" if run.returncode < 0 else f"exit code {run.returncode}"
        told["reason"] = f"the child process that rendered with it ended by {end}: {last[0][:200]}"
    return told


def cache_dir() -> Path:
    """Return the user's cache directory of this program (not created)."""
    if sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    elif os.name == "nt":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "optsim"


def _proof_key(path: Path | None) -> str | None:
    if path is None:
        return None
    try:
        stat = os.stat(path)
    except OSError:
        return None
    versions = [importlib.metadata.version(name) for name in ("drjit", "mitsuba")]
    return json.dumps([os.path.realpath(path), stat.st_size, stat.st_mtime_ns, *versions])


def _read_proofs() -> dict[str, object]:
    try:
        kept = json.loads((cache_dir() / "llvm-proofs.json").read_text())
    except (OSError, ValueError):
        return {}
    return kept if isinstance(kept, dict) else {}


def _write_proof(key: str, verdict: dict[str, object]) -> None:
    """Keep a verdict; a cache that cannot be written only costs the next process a second proof."""
    try:
        folder = cache_dir()
        folder.mkdir(parents=True, exist_ok=True)
        kept = {**_read_proofs(), key: verdict}
        with tempfile.NamedTemporaryFile("w", dir=folder, suffix=".tmp", delete=False) as file:
            json.dump(kept, file)
        os.replace(file.name, folder / "llvm-proofs.json")
    except OSError:
        pass
