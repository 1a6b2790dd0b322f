"""Opens lamogen's files in Blender and measures how far its joints are from where they should be.

Usage: blender -b --factory-startup -noaudio --python blender.py -- WORK.json

WORK.json lists {"file", "joints", "again" or null, "picture" or null}. `joints` names a JSON file of ours: frame rate,
joint names, and positions in metres, Y up; `again` and `picture` what Blender shall export and render. Exit 1 if a joint
is further away than TOLERANCE, or a body does not follow its joints.
"""

import builtins
import json
import math
import os
import sys
import traceback

import bpy
import numpy
from mathutils import Vector

TOLERANCE = 0.002
# How far a body may reach beyond the box around its joints: half a head, a hand, thick limbs.
BODY = 0.3


# Debian 12 builds Blender 3.4 with a Python and a numpy that are newer than its importers: these ask for the file
# mode "rU", gone in Python 3.11, and for numpy.bool, gone in numpy 1.24.
def open_as_ever(file, mode="r", *more, _open=open, **names):
    return _open(file, mode.replace("U", ""), *more, **names)


builtins.open = open_as_ever
if "bool" not in vars(numpy):
    numpy.bool = bool


def open_file(path, frames_per_second):
    """An empty scene with the file in it. Settings other than the scale and the frame rate are Blender's defaults."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = round(frames_per_second)
    if path.endswith(".bvh"):
        bpy.ops.import_anim.bvh(
            filepath=path, global_scale=0.01, update_scene_fps=True, update_scene_duration=True
        )
        rate = scene.render.fps / scene.render.fps_base
        if abs(rate - frames_per_second) > 0.01:
            raise ValueError(f"expected {frames_per_second} frames a second, found {rate}")
    else:
        bpy.ops.import_scene.gltf(filepath=path)


def joints_of_scene(names):
    """A function that gives the joints' places at the current frame, in our axes, and the armature if there is one."""
    armatures = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
    if armatures:
        (armature,) = armatures
        bones = armature.pose.bones

        def places():
            return [armature.matrix_world @ bones[name].head for name in names]

        action = armature.animation_data.action
    else:
        # Without a body, nodes are empties with actions of their own.
        things = [bpy.data.objects[name] for name in names]

        def places():
            return [thing.matrix_world.translation.copy() for thing in things]

        action = things[0].animation_data.action

    def ours():
        # Blender's Z points up and its -Y to the front.
        return [Vector((place.x, place.z, -place.y)) for place in places()]

    return ours, action, bool(armatures)


def body_follows(joints):
    """Whether the evaluated surface surrounds the joints, and closely."""
    graph = bpy.context.evaluated_depsgraph_get()
    points = []
    for thing in bpy.data.objects:
        if thing.type == "MESH" and thing.vertex_groups:
            seen = thing.evaluated_get(graph)
            points += [seen.matrix_world @ vertex.co for vertex in seen.data.vertices]
    points = [(point.x, point.z, -point.y) for point in points]
    for axis in range(3):
        low, high = min(p[axis] for p in points), max(p[axis] for p in points)
        inner = [joint[axis] for joint in joints]
        if not (min(inner) - BODY <= low <= min(inner) and max(inner) <= high <= max(inner) + BODY):
            return False
    return True


def judge(file, reference):
    names, frames = reference["names"], reference["frames"]
    open_file(file, reference["frames_per_second"])
    ours, action, is_rigged = joints_of_scene(names)
    scene = bpy.context.scene
    first, last = (round(frame) for frame in action.frame_range)
    if last - first + 1 != len(frames):
        raise ValueError(f"expected {len(frames)} frames, found {first} to {last}")
    largest, where = 0.0, ""
    for index, pose in enumerate(frames):
        scene.frame_set(first + index)
        found = ours()
        for name, place, expected in zip(names, found, pose):
            distance = (place - Vector(expected)).length
            if not distance <= largest:
                largest, where = distance, f" ({name}, frame {index})"
        if file.endswith(".glb") and is_rigged and not body_follows(found):
            raise ValueError(f"frame {index}: the body does not follow its joints")
    return largest, where


def render(reference, picture):
    """Five moments of the motion in one picture, drawn by Cycles, which needs no screen."""
    scene = bpy.context.scene
    names, frames = reference["names"], reference["frames"]
    scene.frame_set(scene.frame_start)
    first = round(joints_of_scene(names)[1].frame_range[0])
    bodies = [thing for thing in bpy.data.objects if thing.type == "MESH" and thing.vertex_groups]
    for moment in range(5):
        index = moment * (len(frames) - 1) // 4
        scene.frame_set(first + index)
        graph = bpy.context.evaluated_depsgraph_get()
        root = Vector(frames[index][0])
        for body in bodies:
            seen = body.evaluated_get(graph)
            mesh = bpy.data.meshes.new_from_object(seen)
            still = bpy.data.objects.new("still", mesh)
            still.matrix_world = seen.matrix_world.copy()
            still.location.x += 1.5 * (moment - 2) - root.x
            still.location.y += root.z
            scene.collection.objects.link(still)
    for thing in list(bpy.data.objects):
        if thing.name.split(".")[0] != "still":
            thing.hide_render = True

    bpy.ops.mesh.primitive_plane_add(size=60)
    ground = bpy.data.materials.new("ground")
    ground.diffuse_color = (0.8, 0.8, 0.8, 1)
    bpy.context.object.data.materials.append(ground)
    bpy.ops.object.light_add(type="SUN", rotation=(math.radians(40), math.radians(10), math.radians(-30)))
    bpy.context.object.data.energy = 3
    bpy.ops.object.camera_add(location=(0, -9.5, 2.2), rotation=(math.radians(83), 0, 0))
    scene.camera = bpy.context.object
    scene.camera.data.lens = 42
    scene.world = bpy.data.worlds.new("day")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (0.8, 0.85, 0.9, 1)
    scene.view_settings.view_transform = "Standard"
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 48
    # Some builds come without a denoiser.
    scene.cycles.use_denoising = False
    scene.render.resolution_x, scene.render.resolution_y = 960, 360
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True)


def main():
    with open(sys.argv[sys.argv.index("--") + 1], encoding="utf-8") as work:
        work = json.load(work)
    lines, failed = [], not work
    for entry in work:
        with open(entry["joints"], encoding="utf-8") as joints:
            reference = json.load(joints)
        try:
            largest, where = judge(entry["file"], reference)
            verdict = "ok" if largest <= TOLERANCE else "TOO FAR OFF"
            lines.append(f"{1000 * largest:9.4f} mm at most  {verdict}{where}")
            failed |= largest > TOLERANCE
            if entry["again"]:
                bpy.ops.export_scene.gltf(filepath=entry["again"], export_format="GLB")
            if entry["picture"]:
                render(reference, entry["picture"])
        except Exception as error:
            traceback.print_exc()
            lines.append(f"FAILED: {error}")
            failed = True
        lines[-1] = f"judge: {os.path.basename(entry['file']):24} {lines[-1]}"
    # Blender talks a lot between these.
    print("\n" + "\n".join(lines), flush=True)
    # A failing script does not make Blender fail.
    sys.exit(1 if failed else 0)


main()
