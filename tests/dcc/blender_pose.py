"""Runs in Blender's Python: imports a dressed character, poses its armature, saves what it sees.

    python blender_pose.py DRESSED POSES.npz OUT.npz

POSES holds ``joints`` (names, as USD paths) and, for each pose, the joints' skinning matrices in
Blender's world, shape [j, 4, 4]. OUT gets ``<pose>/<mesh>``: world positions of the mesh's points as
the modifiers put them; ``rest/<mesh>`` without a pose; ``groups/<mesh>``: how many vertex groups have
weight; ``weights/<mesh>``: the dense weights, shape [n, j], in the order of ``joints``.
"""

import sys

import bpy
import numpy as np
from mathutils import Matrix


def world_points(name: str) -> np.ndarray:
    """Where the modifiers put a mesh's points, shape [n, 3]."""
    graph = bpy.context.evaluated_depsgraph_get()
    evaluated = bpy.data.objects[name].evaluated_get(graph)
    mesh = evaluated.to_mesh()
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    evaluated.to_mesh_clear()
    world = np.array(evaluated.matrix_world)
    return points.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]


def pose(armature: "bpy.types.Object", bones: dict[str, int], matrices: np.ndarray) -> None:
    """Moves every bone by its joint's skinning matrix."""
    world = np.array(armature.matrix_world)
    inside = np.linalg.inv(world) @ matrices @ world
    rest = {b.name: np.array(b.matrix_local) for b in armature.data.bones}
    posed = {name: inside[j] @ rest[name] for name, j in bones.items()}
    for bone in armature.pose.bones:
        above = bone.parent.name if bone.parent else None
        local = rest[bone.name] if above is None else np.linalg.inv(rest[above]) @ rest[bone.name]
        wanted = posed[bone.name] if above is None else np.linalg.inv(posed[above]) @ posed[bone.name]
        bone.matrix_basis = Matrix(np.linalg.inv(local) @ wanted)
    bpy.context.view_layer.update()


def weights(mesh: "bpy.types.Object", joints: list[str]) -> np.ndarray:
    """Vertex groups as dense weights, shape [n, j]."""
    place = {name: j for j, name in enumerate(joints)}
    of_group = {g.index: place[g.name] for g in mesh.vertex_groups}
    dense = np.zeros((len(mesh.data.vertices), len(joints)))
    for v in mesh.data.vertices:
        for g in v.groups:
            dense[v.index, of_group[g.group]] = g.weight
    return dense


def main(dressed: str, poses: str, out: str) -> None:
    """Imports, poses, saves."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=dressed)
    given = dict(np.load(poses))
    joints = [str(j).rsplit("/", 1)[-1] for j in given.pop("joints")]
    (armature,) = (o for o in bpy.data.objects if o.type == "ARMATURE")
    missing = {b.name for b in armature.data.bones} ^ set(joints)
    if missing:
        raise SystemExit(f"bones and joints differ: {sorted(missing)}")
    bones = {name: j for j, name in enumerate(joints)}
    meshes = [o for o in bpy.data.objects if o.type == "MESH"]
    found = {}
    for mesh in meshes:
        bound = [m.object for m in mesh.modifiers if m.type == "ARMATURE"]
        if bound != [armature]:
            raise SystemExit(f"{mesh.name} is bound to {bound}")
        found[f"weights/{mesh.name}"] = weights(mesh, joints)
        found[f"rest/{mesh.name}"] = world_points(mesh.name)
    for name, matrices in given.items():
        pose(armature, bones, matrices)
        for mesh in meshes:
            found[f"{name}/{mesh.name}"] = world_points(mesh.name)
    np.savez(out, **found)


if __name__ == "__main__":
    main(*sys.argv[-3:])
