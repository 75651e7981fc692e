"""Scene <-> TOML or JSON. A scene file is data only: nothing in it runs, and it reaches no file outside its own folder."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from scenes import library
from scenes.errors import InputError
from scenes.file_shapes import FORMS, PLACEMENT, procedural_mesh, turned_and_moved
from scenes.file_spectra import MAX_BYTES, inside, parse_spectrum, require_keys, spectrum_data, under
from scenes.file_textures import texture_fields
from scenes.framing import lens_on, orthographic_on, perspective_on
from scenes.lights import AreaLight, ConstantSky, DirectionalLight, GradientSky, PointLight
from scenes.materials import Conductor, Dielectric, Diffuse, RoughPlastic
from scenes.meshes import read_mesh, read_regular
from scenes.model import Model, did_you_mean
from scenes.scene import Scene
from scenes.shapes import Box, Mesh, Rectangle, Sphere
from scenes.spectrum import Spectrum
from scenes.textures import Textured
from scenes.viewpoint import Orthographic, Perspective, ThinLens

FORMAT = "optsim-scene-1"
MAX_INLINE_WEIGHTS = 1000
Kinds = dict[str, type[Model]]

MATERIAL_KINDS: Kinds = {
    "diffuse": Diffuse,
    "textured": Textured,
    "dielectric": Dielectric,
    "rough-plastic": RoughPlastic,
    "conductor": Conductor,
}
SHAPE_KINDS: Kinds = {"rectangle": Rectangle, "box": Box, "sphere": Sphere, "mesh": Mesh}
LIGHT_KINDS: Kinds = {
    "area": AreaLight,
    "directional": DirectionalLight,
    "point": PointLight,
    "sky": ConstantSky,
    "gradient-sky": GradientSky,
}
VIEWPOINT_KINDS: Kinds = {"orthographic": Orthographic, "perspective": Perspective, "thin-lens": ThinLens}
SPECTRUM_FIELDS: dict[str, Callable[[str], Spectrum] | None] = {
    "reflectance": library.reflectance,
    "radiance": library.illuminant,
    "irradiance": library.illuminant,
    "intensity": library.illuminant,
    "eta": None,
    "k": None,
}
"""The fields that hold spectra, and where a bare name in them is looked up."""


def read_scene(path: Path | str) -> Scene:
    """Read a scene file of at most 1 MiB; spectra as CSV and meshes may lie beside it, in its own folder.

    Raises:
        InputError: naming the offending place, e.g. ``materials.red.reflectance``, and what is allowed there.
    """
    path = Path(path)
    readers = {".toml": _read_toml, ".json": _read_json}
    if path.suffix.lower() not in readers:
        raise InputError("scene", str(path), "a scene file of type .toml or .json")
    data = read_regular(path, MAX_BYTES, "scene")
    try:
        return scene_from_data(readers[path.suffix.lower()](data.decode("utf-8")), path.parent)
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise InputError("scene", str(path), f"a readable {path.suffix[1:].upper()} file ({error})") from None


def write_scene(scene: Scene, path: Path | str) -> None:
    """Write a scene as TOML or JSON, by the file's suffix; it reads back as an equal scene.

    Weights of textures of more than 1000 numbers go into NPY files beside it, named after the file and the material.

    Raises:
        InputError: for another suffix, or a scene that needs more than 1 MiB (a big mesh).
    """
    path = Path(path)
    data = scene_to_data(scene)
    tables: dict[str, np.ndarray] = {}
    for number, (name, material) in enumerate(scene.materials.items()):
        if isinstance(material, Textured) and material.weights.size > MAX_INLINE_WEIGHTS:
            file = f"{path.stem}-texture{number}.npy"
            tables[file] = material.weights
            data["materials"][name]["weights"] = file
    if path.suffix.lower() == ".toml":
        import tomli_w

        text = tomli_w.dumps(data)
    elif path.suffix.lower() == ".json":
        text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    else:
        raise InputError("scene", str(path), "a scene file of type .toml or .json")
    if len(text.encode()) > MAX_BYTES:
        raise InputError("scene", len(text.encode()), f"at most {MAX_BYTES} bytes as text (keep big meshes in files of their own)")
    for file, table in tables.items():
        np.save(path.parent / file, table)
    path.write_text(text, encoding="utf-8")


def scene_to_data(scene: Scene) -> dict[str, Any]:
    """Return a scene as plain dicts, lists, strings and numbers."""
    return {
        "format": FORMAT,
        "name": scene.name,
        "description": scene.description,
        "viewpoint": _to_data(scene.viewpoint, VIEWPOINT_KINDS),
        "materials": {name: _to_data(material, MATERIAL_KINDS) for name, material in scene.materials.items()},
        "lights": [_to_data(light, LIGHT_KINDS) for light in scene.lights],
        "shapes": [_to_data(shape, SHAPE_KINDS) for shape in scene.shapes],
    }


def scene_from_data(data: Any, folder: Path | None = None) -> Scene:
    """Build a scene from plain data.

    Args:
        data: as ``scene_to_data`` returns it, or shorter (names in place of spectra).
        folder: where CSV and mesh files may lie; None allows none.

    Raises:
        InputError: naming the offending place.
    """
    table = _table(data, "scene")
    require_keys(table, ("format", "name", "description", "viewpoint", "materials", "lights", "shapes"), "")
    if table.get("format", FORMAT) != FORMAT:
        raise InputError("format", table["format"], repr(FORMAT))
    if "viewpoint" not in table:
        raise InputError("viewpoint", None, "given")
    materials = _table(table.get("materials", {}), "materials")
    shapes, lights = _list(table.get("shapes", []), "shapes"), _list(table.get("lights", []), "lights")
    built = tuple(_build(shape, SHAPE_KINDS, _shape_place(shape, i), folder) for i, shape in enumerate(shapes))
    return Scene(
        name=table.get("name", ""),
        description=table.get("description", ""),
        viewpoint=_viewpoint(table["viewpoint"], built),
        materials={name: _build(m, MATERIAL_KINDS, f"materials.{name}", folder) for name, m in materials.items()},
        lights=tuple(_build(light, LIGHT_KINDS, f"lights[{i}]", folder) for i, light in enumerate(lights)),
        shapes=built,
    )


def _viewpoint(data: Any, shapes: tuple[Any, ...]) -> Any:
    """Build a viewpoint; ``square_on = NAME, distance = METRES`` aligns it to a rectangle that then fills the picture's height."""
    fields = dict(_table(data, "viewpoint"))
    if "square_on" not in fields:
        return _build(fields, VIEWPOINT_KINDS, "viewpoint", None)
    makers: dict[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
        "orthographic": (orthographic_on, ()),
        "perspective": (perspective_on, ()),
        "thin-lens": (lens_on, ("aperture_m",)),
    }
    kind = fields.get("kind")
    if not isinstance(kind, str) or kind not in makers:
        raise InputError("viewpoint.kind", kind, f"one of {', '.join(makers)}{did_you_mean(str(kind), makers)}")
    make, more = makers[kind]
    require_keys(fields, ("kind", "square_on", "distance", *more), "viewpoint")
    flat = {shape.name: shape for shape in shapes if isinstance(shape, Rectangle)}
    name = fields["square_on"]
    if not isinstance(name, str) or name not in flat:
        raise InputError("viewpoint.square_on", name, f"the name of a rectangle: {', '.join(flat) or '(there is none)'}")
    return make(flat[name], fields.get("distance"), *(fields.get(word) for word in more))


def _build(data: Any, kinds: Kinds, place: str, folder: Path | None) -> Any:
    fields = dict(_table(data, place))
    kind = fields.pop("kind", None)
    if kinds is SHAPE_KINDS and isinstance(kind, str) and kind in FORMS:
        return under(place, procedural_mesh, kind, fields, place)
    known = [*kinds, *FORMS] if kinds is SHAPE_KINDS else [*kinds]
    if not isinstance(kind, str) or kind not in kinds:
        raise InputError(f"{place}.kind", kind, f"one of {', '.join(known)}{did_you_mean(str(kind), known)}")
    model = kinds[kind]
    for name in fields:
        if name in SPECTRUM_FIELDS and name in model.model_fields:
            fields[name] = parse_spectrum(fields[name], f"{place}.{name}", folder, SPECTRUM_FIELDS[name])
    if model is Textured:
        fields = texture_fields(fields, place, folder)
    try:
        if model is Mesh and "file" in fields:
            return _mesh_from_file(fields, place, folder)
        return model(**fields)
    except InputError as error:
        inner = error.field.removeprefix(model.place).removeprefix(".")
        field = error.field if error.field.startswith(place) and place != model.place else ".".join(filter(None, [place, inner]))
        raise InputError(field, error.value, error.allowed) from None


def _mesh_from_file(fields: dict[str, Any], place: str, folder: Path | None) -> Mesh:
    require_keys(fields, ("name", "material", "file", "metres_per_unit", *PLACEMENT), place)
    if folder is None:
        raise InputError("file", fields["file"], "left out: this scene has no folder of its own")
    scale = fields.get("metres_per_unit", 1.0)
    if isinstance(scale, bool) or not isinstance(scale, int | float):
        raise InputError("metres_per_unit", scale, "a number above 0 m")
    path = inside(folder, fields["file"], f"{place}.file")
    return read_mesh(path, fields.get("name", ""), fields.get("material", ""), scale, turned_and_moved(fields, place))


def _to_data(thing: Model, kinds: Kinds) -> dict[str, Any]:
    kind = next(word for word, model in kinds.items() if type(thing) is model)
    values = {name: getattr(thing, name) for name in type(thing).model_fields}
    return {"kind": kind} | {name: _plain(value) for name, value in values.items() if value is not None}


def _plain(value: Any) -> Any:
    if isinstance(value, Spectrum):
        return spectrum_data(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _shape_place(shape: Any, index: int) -> str:
    name = shape.get("name") if isinstance(shape, dict) else None
    return f"shapes.{name}" if isinstance(name, str) and name else f"shapes[{index}]"


def _table(data: Any, place: str) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise InputError(place, type(data).__name__, "a table of named values")
    return data


def _list(data: Any, place: str) -> list[Any]:
    if not isinstance(data, list):
        raise InputError(place, type(data).__name__, "a list")
    return data


def _read_toml(text: str) -> Any:
    return tomllib.loads(text)


def _read_json(text: str) -> Any:
    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        table = dict(items)
        if len(table) < len(items):
            names = [name for name, _ in items]
            raise InputError("scene", next(n for n in names if names.count(n) > 1), "JSON without repeated keys")
        return table

    def refuse(word: str) -> Any:
        raise InputError("scene", word, "finite numbers only")

    return json.loads(text, object_pairs_hook=pairs, parse_constant=refuse)
