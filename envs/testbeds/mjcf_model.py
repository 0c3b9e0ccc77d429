"""Models of MuJoCo's files: compiled, without visual meshes that are missing; what they hold."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from integ_gym.support.errors import FileWarning, InputError, describe_exception
from integ_gym.support.optional import check_versions, load

from .mjcf_figures import feet_of


class CompiledModel(NamedTuple):
    """A compiled model and the file that it is of.

    Attributes:
        model: MuJoCo's `MjModel`, which its users copy.
        xml: the model as one file, which names meshes and does not hold them; None under a MuJoCo
            that cannot write it.
        sha256: of the model as one file of XML and of the meshes, textures and height fields that
            it reads; None under a MuJoCo that cannot write it.
        folder: of its files.
    """

    model: Any
    xml: str | None = None
    sha256: str | None = None
    folder: Path = Path()


def compile_model(source: Any) -> CompiledModel:
    """Compile a model; visual meshes and textures whose files are missing are left out.

    What is left out is warned of in one sentence. It changes no motion: a mesh that collides, or
    that a body's mass is computed from, is refused.

    Args:
        source: path of an MJCF or URDF file, or a `mujoco.MjSpec`.

    Raises:
        ValueError: for a model that cannot be compiled, or whose missing mesh counts, by its name.
    """
    check_versions("mujoco")
    if not isinstance(source, str | os.PathLike):
        return _compile(source)
    if not Path(source).is_file():
        raise InputError(f"there is no model file {os.fspath(source)}; give its path")
    return _compile_file(os.fspath(source), Path(source).stat().st_mtime_ns)


@lru_cache(maxsize=8)
def _compile_file(path: str, modified: int) -> CompiledModel:
    """A file's model, compiled and warned of once in a process while the file stays."""
    return _compile(path)


def compile_sensing(source: Any) -> Any:
    """Compile a model's motion with one sensor of contacts, for a batch.

    What only shows is left out. The sensor, in place of the model's own, counts contacts and has
    the least of their distances, m.
    """
    mujoco = load("mujoco", "mujoco")
    spec, *_ = _read(mujoco, source)
    spec.compiler.discardvisual = True
    for own in list(spec.sensors):
        spec.delete(own)
    sensor, data, nearest = spec.add_sensor(), mujoco.mjtConDataField, 1
    sensor.type = mujoco.mjtSensor.mjSENS_CONTACT
    sensor.intprm[:] = 1 << int(data.mjCONDATA_FOUND) | 1 << int(data.mjCONDATA_DIST), nearest, 1
    return spec.compile()


def _read(mujoco: Any, source: Any) -> tuple[Any, Path, list[str]]:
    """A copy of a model's `MjSpec`, the folder of its files, and which were left out."""
    is_path = isinstance(source, str | os.PathLike)
    spec = mujoco.MjSpec.from_file(os.fspath(source)) if is_path else source.copy()
    folder = Path(source).parent if is_path else Path(spec.modelfiledir)
    return spec, folder, _leave_out_missing(mujoco, spec, folder)


def _compile(source: Any) -> CompiledModel:
    mujoco = load("mujoco", "mujoco")
    is_path = isinstance(source, str)
    title = source if is_path else "the MjSpec"
    try:
        if is_path and not hasattr(mujoco, "MjSpec"):  # as before MuJoCo 3.2
            return CompiledModel(mujoco.MjModel.from_xml_path(source))
        spec, folder, left_out = _read(mujoco, source)
        model = spec.compile()
    except InputError:
        raise
    except Exception as error:  # MuJoCo's errors are ValueErrors, and others before 3.3
        raise InputError(f"{title} cannot be compiled: {describe_exception(error)}") from error
    if left_out:
        more = f" and {len(left_out) - 3} more" if len(left_out) > 3 else ""
        warnings.warn(
            f"{title}: {len(left_out)} files of meshes and textures that only show are missing "
            f"and left out, which changes no motion: {', '.join(left_out[:3])}{more}",
            FileWarning,
            stacklevel=4,
        )
    return CompiledModel(model, spec.to_xml(), _hash(spec, folder), folder)


def _hash(spec: Any, folder: Path) -> str:
    digest, held = hashlib.sha256(spec.to_xml().encode()), _held(spec)
    for asset in (*spec.meshes, *spec.hfields, *spec.skins, *spec.textures):
        of_texture = getattr(asset, "cubefiles", None)
        own = spec.meshdir if of_texture is None else spec.texturedir
        for file in (asset.file, *(of_texture or ())):
            places = [folder / own / file, folder / file]
            found = next((place for place in places if file and place.is_file()), None)
            digest.update(held.get(file, b"") if found is None else found.read_bytes())
    return digest.hexdigest()


def _leave_out_missing(mujoco: Any, spec: Any, folder: Path) -> list[str]:
    """Delete what only shows and whose file is missing; names of these files."""

    def is_missing(file: str, own: str) -> bool:
        places = folder / own / file, folder / file
        return bool(file) and file not in held and not any(place.is_file() for place in places)

    held = _held(spec)
    meshes = {_name(one): one for one in spec.meshes if is_missing(one.file, spec.meshdir)}
    textures = [one for one in spec.textures if is_missing(one.file, spec.texturedir)]
    always = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE)
    from_geoms = int(getattr(spec, "compiler", spec).inertiafromgeom) == always
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    for geom in [one for one in spec.geoms if one.meshname in meshes]:
        label, body = f"geom {geom.name!r}" if geom.name else "a geom", geom.parent
        of = f"{label} of body {body.name!r}"
        if geom.contype or geom.conaffinity or (geom.name and geom.name in paired):
            raise InputError(f"{of} collides, and {_file_of(meshes, geom)} is missing; add it")
        if (from_geoms or not body.explicitinertial) and body.name != "world":
            raise InputError(
                f"the mass of body {body.name!r} is computed from its geoms, and "
                f"{_file_of(meshes, geom)} is missing; add it, or give the body an <inertial> and "
                'leave out inertiafromgeom="true"'
            )
        spec.delete(geom)
    of_textures = {_name(texture) for texture in textures}
    for material in spec.materials:
        kept = ["" if name in of_textures else name for name in material.textures]
        if kept != list(material.textures):
            material.textures = kept
    for asset in (*meshes.values(), *textures):
        spec.delete(asset)
    return [Path(asset.file).name for asset in (*meshes.values(), *textures)]


def _name(asset: Any) -> str:
    """What a mesh or texture is called: without a name of its own as its file, without ending."""
    return str(asset.name or Path(asset.file).stem)


def _held(spec: Any) -> dict[str, bytes]:
    """Files that an `MjSpec` was given in memory, by name."""
    return getattr(spec, "assets", {})  # MuJoCo 3.2.5 has none


def _file_of(meshes: dict[str, Any], geom: Any) -> str:
    return f"the mesh {geom.meshname!r} ({Path(meshes[geom.meshname].file).name})"


def describe_actuators(mujoco: Any, model: Any) -> list[dict[str, Any]]:
    """The actuators as the model has them: kind, target, gains and limits.

    `kp` (N/m or N m/rad) and `kv` (N s/m or N m s/rad) are those of servos. Limits are left out
    where there are none.
    """
    return [_describe_actuator(mujoco, model, index) for index in range(model.nu)]


def _describe_actuator(mujoco: Any, model: Any, index: int) -> dict[str, Any]:
    own = model.actuator(index)
    description: dict[str, Any] = {"name": own.name}
    if int(own.trntype[0]) == int(mujoco.mjtTrn.mjTRN_JOINT):
        joint = model.joint(int(own.trnid[0]))
        description |= {"joint": joint.name}
        if getattr(model, "jnt_actfrclimited", [False] * model.njnt)[joint.id]:
            description |= {"joint_force_range": _floats(model.jnt_actfrcrange[joint.id])}
    gain, bias = float(own.gainprm[0]), _floats(own.biasprm[:3])
    stateless = int(own.dyntype[0]) == int(mujoco.mjtDyn.mjDYN_NONE)
    fixed = stateless and int(own.gaintype[0]) == int(mujoco.mjtGain.mjGAIN_FIXED)
    affine = int(own.biastype[0]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if fixed and int(own.biastype[0]) == int(mujoco.mjtBias.mjBIAS_NONE):
        description |= {"kind": "motor"}
    elif fixed and affine and gain and bias[:2] == [0.0, -gain]:
        description |= {"kind": "position", "kp": gain, "kv": 0.0 - bias[2]}
    elif fixed and affine and gain and bias == [0.0, 0.0, -gain]:
        description |= {"kind": "velocity", "kv": gain}
    else:
        description |= {
            "kind": "general",
            "gainprm": _floats(own.gainprm),
            "biasprm": _floats(own.biasprm),
        }
    if own.ctrllimited[0]:
        description |= {"ctrlrange": _floats(own.ctrlrange)}
    if own.forcelimited[0]:
        description |= {"forcerange": _floats(own.forcerange)}
    gear = _floats(own.gear)
    return description if gear == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0] else {**description, "gear": gear}


def _floats(values: Iterable[Any]) -> list[float]:
    return [0.0 + float(x) for x in values]


_GEOMS = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
_JOINTS = ("free", "ball", "slide", "hinge")


def describe_skeleton(mujoco: Any, model: Any, coordinates: Iterable[str]) -> dict[str, Any]:
    """What a film needs of a compiled model: no mesh, and nothing that changes its motion.

    Args:
        mujoco: the module.
        model: compiled model.
        coordinates: name of each joint position.

    Returns:
        ``coordinates``; ``weight``, N; ``feet``, their bodies by name; ``floor``, height of the
        first plane, m, or None; ``bodies``, but for the world, as [parent, position, quaternion],
        with parent −1 for the world; ``joints`` as [body, kind, place among the coordinates, axis,
        position, reference]; ``geoms`` as [body, kind, sizes, position, quaternion]. In m and the
        frame of the body or parent.
    """
    geoms = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")): kind for kind in _GEOMS}
    joints = {int(getattr(mujoco.mjtJoint, f"mjJNT_{kind.upper()}")): kind for kind in _JOINTS}
    planes = [g for g, kind in enumerate(model.geom_type) if kind == mujoco.mjtGeom.mjGEOM_PLANE]
    return {
        "coordinates": list(coordinates),
        "weight": round(float(model.body_subtreemass[0] * -model.opt.gravity[2]), 2),
        "feet": {name: body - 1 for name, body in feet_of(model).items()},
        "floor": round(float(model.geom_pos[planes[0], 2]), 4) if planes else None,
        "bodies": [
            [
                int(model.body_parentid[k]) - 1,
                *_round_vectors(model.body_pos[k], model.body_quat[k]),
            ]
            for k in range(1, model.nbody)
        ],
        "joints": [
            [
                int(model.jnt_bodyid[k]) - 1,
                joints[int(kind)],
                int(model.jnt_qposadr[k]),
                *_round_vectors(model.jnt_axis[k], model.jnt_pos[k]),
                round(float(model.qpos0[model.jnt_qposadr[k]]), 4),
            ]
            for k, kind in enumerate(model.jnt_type)
        ],
        "geoms": [
            [
                int(model.geom_bodyid[k]) - 1,
                geoms[int(kind)],
                *_round_vectors(model.geom_size[k], model.geom_pos[k], model.geom_quat[k]),
            ]
            for k, kind in enumerate(model.geom_type)
            if int(kind) in geoms
        ],
    }


def _round_vectors(*vectors: Any) -> list[list[float]]:
    return [[0.0 + round(float(x), 4) for x in vector] for vector in vectors]
