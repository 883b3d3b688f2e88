"""Runs inside Blender: looks at places through Cycles after jobs/recipes/blender.py, one pixel a place.

  blender --background -noaudio --factory-startup [own.blend] --python blender_probe.py -- RECIPE DIR PLACES.json
  RESULT.json [PICTURE.png]

PLACES.json is {reach, places: [{position, normal}]}, glTF's axes; RESULT.json {version, places: [{radiance, irradiance,
hit}]}. A camera without perspective stands over each place and looks against its normal. One animation of as many
frames as places, a pixel each, twice: as the recipe leaves the materials, and with a white albedo in its nodes.
Emission and position are Cycles' own passes.
"""
import importlib.util
import json
import math
import os
import sys
import tempfile

import bpy
import mathutils
import numpy

recipe_path, folder, places_path, result_path, *picture = sys.argv[sys.argv.index('--') + 1:]
spec = importlib.util.spec_from_file_location('recipe', recipe_path)
recipe = importlib.util.module_from_spec(spec)
spec.loader.exec_module(recipe)

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))


def turned(v):
    """From glTF's axes, y up, to Blender's, z up."""
    return mathutils.Vector((v[0], -v[2], v[1]))


def camera_track(places, reach):
    camera = bpy.data.objects.new('probe', bpy.data.cameras.new('probe'))
    bpy.context.scene.collection.objects.link(camera)
    camera.data.type, camera.data.ortho_scale = 'ORTHO', reach / 8
    camera.data.clip_start, camera.data.clip_end = 0.0, 2 * reach
    camera.rotation_mode = 'QUATERNION'
    for frame, place in enumerate(places):
        normal = turned(place['normal'])
        camera.location, camera.rotation_quaternion = turned(place['position']) + normal * reach, normal.to_track_quat(
            'Z', 'Y')
        camera.keyframe_insert('location', frame=frame)
        camera.keyframe_insert('rotation_quaternion', frame=frame)
    for curve in camera.animation_data.action.fcurves:
        for point in curve.keyframe_points:
            point.interpolation = 'CONSTANT'
    return camera


def settings(count, folder):
    scene = bpy.context.scene
    scene.render.engine = 'CYCLES'
    scene.cycles.device, scene.cycles.samples, scene.cycles.max_bounces = 'CPU', 1, 0
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = 'BOX', 0.01
    scene.render.resolution_x = scene.render.resolution_y = 1
    scene.render.resolution_percentage = 100
    scene.render.use_persistent_data = True
    scene.render.threads_mode, scene.render.threads = 'FIXED', 2
    scene.frame_start, scene.frame_end = 0, count - 1
    scene.render.film_transparent = True
    layer = bpy.context.view_layer
    layer.use_pass_emit = layer.use_pass_position = True
    image = scene.render.image_settings
    image.file_format, image.color_depth, image.exr_codec = 'OPEN_EXR_MULTILAYER', '32', 'ZIP'
    scene.render.filepath = os.path.join(folder, 'f')


def render(count):
    """[(radiance, hit)] of all frames, hit in glTF's axes."""
    import exr
    with tempfile.TemporaryDirectory() as folder:
        settings(count, folder)
        bpy.ops.render.render(animation=True)
        result = []
        for frame in range(count):
            channels = exr.read(os.path.join(folder, 'f%04d.exr' % frame)).channels
            value = {name.split('.', 1)[1]: float(v[0, 0]) for name, v in channels.items()}
            radiance = [value['Emit.' + c] for c in 'RGB']
            x, y, z = (value['Position.' + c] for c in 'XYZ')
            result.append((radiance, [x, z, -y] if value['Combined.A'] > 0 else None))
        return result


def whiten(things):
    for thing, _, _ in things:
        for material in thing.data.materials:
            tree = material.node_tree
            tree.nodes['kiln albedo'].inputs['Fac'].default_value = 0.0  # leaves E alone
            output = next(n for n in tree.nodes if n.type == 'OUTPUT_MATERIAL')
            glow = next(n for n in tree.nodes if n.type == 'EMISSION' and n.inputs['Color'].is_linked and
                        n.inputs['Color'].links[0].from_node.name == 'kiln albedo')
            tree.links.new(glow.outputs['Emission'], output.inputs['Surface'])


def look(path):
    """A picture by EEVEE's or Cycles' light from the scene's own camera, or from in front."""
    scene = bpy.context.scene
    cameras = [o for o in bpy.data.objects if o.type == 'CAMERA']
    if not cameras:
        camera = bpy.data.objects.new('front', bpy.data.cameras.new('front'))
        scene.collection.objects.link(camera)
        corners = [o.matrix_world @ mathutils.Vector(c) for o in bpy.data.objects if o.type == 'MESH'
                   for c in o.bound_box]
        low, high = (mathutils.Vector([f(c[i] for c in corners) for i in range(3)]) for f in (min, max))
        camera.location = (low + high) / 2 + mathutils.Vector((0, -0.9 * (high - low).length, 0))
        camera.rotation_euler = (math.pi / 2, 0, 0)
        cameras = [camera]
    scene.camera = cameras[0]
    scene.render.engine, scene.cycles.samples, scene.cycles.max_bounces = 'CYCLES', 8, 0
    scene.cycles.use_denoising = False
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    scene.render.image_settings.file_format = 'PNG'
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)


def main():
    with open(places_path) as f:
        request = json.load(f)
    own_objects = bpy.data.filepath != ''
    if not own_objects:
        bpy.ops.wm.read_factory_settings(use_empty=True)
    things = recipe.apply(folder, own_objects)
    if picture:
        look(os.path.abspath(picture[0]))
    places = request['places']
    bpy.context.scene.camera = camera_track(places, request['reach'])
    shown = render(len(places))
    whiten(things)
    white = render(len(places))
    result = [dict(radiance=r, irradiance=[math.pi * c for c in w], hit=h) for (r, _), (w, h) in zip(shown, white)]
    with open(result_path, 'w') as f:
        json.dump(dict(version=bpy.app.version_string, places=result), f)


main()
