"""Several people's results as one USD stage, which refers to each person's own file beside it.

Layout::

    /World           mmocap:people and mmocap:results, their names and the names of those files
    /World/<person>  the body in that file, animated; its looks and motion come from there
    /World/Cameras   the cameras of the first
"""

from pathlib import Path

from pxr import Sdf, Usd

from mmocap_warp.formats.usd import usd_file
from mmocap_warp.formats.usd.usd_result import PEOPLE, PRIMS_OF_ALL, new_world
from mmocap_warp.result.result import Result

_REMEDY = "track the people again"


def write_people(path: Path, people: dict[str, tuple[Path, Result]]) -> None:
    """Write what refers to the files of people's results, which lie beside it, by the people's names."""
    (_, first), *_ = people.values()
    files = {name: f"./{file.name}" for name, (file, _) in people.items()}
    stage = new_world(first.cameras.up)
    usd_file.author(stage.GetDefaultPrim(), PEOPLE, list(files))
    usd_file.author(stage.GetDefaultPrim(), "mmocap:results", list(files.values()))
    usd_file.set_time_range(stage, first.frame_numbers, first.fps)
    layer = Sdf.Layer.CreateAnonymous()
    layer.TransferContent(stage.GetRootLayer())
    prims = usd_file.valid_names(people, PRIMS_OF_ALL)
    bodies = [(prim, name, people[name][1].subject.body.name) for name, prim in prims.items()]
    for prim, name, target in (*bodies, ("Cameras", next(iter(files)), "Cameras")):
        spec = Sdf.CreatePrimInLayer(layer, f"/World/{prim}")
        spec.specifier = Sdf.SpecifierDef
        spec.referenceList.prependedItems.append(Sdf.Reference(files[name], f"/World/{target}"))
    # A stage that shows nothing looks for none of the files from where it is not yet.
    usd_file.write_stage(path, Usd.Stage.OpenMasked(layer, Usd.StagePopulationMask(["/None"])))


@usd_file.reads_usd
def results_in(path: str | Path) -> dict[str, Path]:
    """The files of people's results by the people's names; none where the file is no such stage."""
    return results_of(usd_file.read_stage(path), path)


def results_of(stage: Usd.Stage, path: str | Path) -> dict[str, Path]:
    """As :func:`results_in`, of a stage that was read from ``path``."""
    if not stage.GetAttributeAtPath(f"/World.{PEOPLE}"):
        return {}
    read = usd_file.PrimReader(stage.GetPrimAtPath("/World"), path, _REMEDY)
    names, files = read.texts(PEOPLE), read.texts("mmocap:results")
    read.require(bool(names) and len(names) == len(files), "people and their files are not as many")
    own = [Path(file).name for file in files]
    beside = [f"./{name}" for name in own] == files and not {"", ".."} & {*own}
    read.require(beside, "people's files do not lie beside it")
    return {name: Path(path).parent / file for name, file in zip(names, own, strict=True)}
