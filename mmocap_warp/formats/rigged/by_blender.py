"""Characters in files that Blender reads: it writes them as ``.glb``, without a window, where it is installed."""

import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged.gltf import read_gltf
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh
from mmocap_warp.masks.mask_program import end_program

_SECONDS = 600.0  # that Blender may take
_SCRIPT = """
import sys, bpy
source, target = sys.argv[-2:]
bpy.ops.wm.read_factory_settings(use_empty=True)
read = bpy.ops.wm.fbx_import if "fbx_import" in dir(bpy.ops.wm) else bpy.ops.import_scene.fbx
wanted = {"export_materials": "NONE", "export_all_influences": True, "export_anim_slide_to_zero": True}
known = bpy.ops.export_scene.gltf.get_rna_type().properties.keys()  # old versions have fewer
try:
    read(filepath=source)
    bpy.ops.export_scene.gltf(filepath=target, **{name: wanted[name] for name in wanted if name in known})
except Exception as error:
    sys.exit([line for line in str(error).splitlines() if line.strip() and not line.startswith("Location: ")][-1])
"""


def read_fbx(path: Path, character: str | None, blender: str) -> RiggedMesh:
    """Read the ``.glb`` that a program ``blender``, a name or a path, makes of an ``.fbx``.

    Raises:
        InputError: there is no such program, it fails or takes too long, or what it makes holds no character.
    """
    program = shutil.which(blender)
    if program is None:
        remedy = "install Blender, name its program with --blender, or save the file as .glb"
        raise InputError(path, f"is read by way of Blender, and there is no program '{blender}'", remedy)
    with TemporaryDirectory() as folder:
        target = Path(folder) / f"{path.stem}.glb"
        command = [program, "--background", "--factory-startup", "--python-exit-code", "1", "--python-expr", _SCRIPT]
        command += ["--", str(path.resolve()), str(target)]
        problem = _run(command) or (None if target.is_file() else "wrote nothing")
        if problem is not None:
            raise InputError(path, f"cannot be read by {program}, which {problem}", "open it there and save it as .glb")
        try:
            return read_gltf(target, character)
        except InputError as error:
            raise InputError(path, f"as Blender reads it, {error.problem}", error.remedy) from None


def _run(command: list[str]) -> str | None:
    """Run Blender to its end, and say what went wrong."""
    pipe = subprocess.PIPE
    try:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, start_new_session=True, errors="replace"
        )
    except OSError as error:
        return f"cannot be started ({error.strerror})"
    with process:
        try:
            said = process.communicate(timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            return f"takes more than {_SECONDS:.0f} s"
        finally:
            end_program(process)
    lines = [line.strip() for each in said for line in each.splitlines() if line.strip()]
    return f"says: {lines[-1] if lines else 'nothing'}" if process.returncode else None
