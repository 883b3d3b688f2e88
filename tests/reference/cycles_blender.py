"""Runs inside Blender: makes an interior as an artist does, exports it, and bakes it with Cycles. For cycles.py beside
this.

  blender --background -noaudio --factory-startup --python cycles_blender.py -- NAME FOLDER SIDE SAMPLES BOUNCES
  [--single-sided] [--no-bake]

Writes FOLDER/scene.glb with the exporter's own defaults (which mark every material double-sided) but with lights, and
FOLDER/OBJECT_1.exr and _2 (two seeds, SAMPLES each) of E / pi in W/m2, rows from the top as in glTF, alpha where Cycles
found the surface. Every object has a second UV map, unwrapped by Blender.

  sunny      a room with walls of 20 cm, a window, a sun and a sky (the world, which glTF does not hold: kiln's
             --environment), table, ball
  flat       two rooms and a door, walls without thickness, point lamps, a box, a sheet of paper that hangs in the light
  furnished  a room without thickness, seen from inside, a lamp of a glowing material, a shelf of thin boards, a
  curtain, crates, a torus

Before the bake each Principled shader becomes a diffuse one of the same base colour, for kiln bakes diffuse light
alone; lamps have no size, for glTF's have none. No clamping, no threshold for weak lights, no adaptive sampling, no
denoiser.
"""
import builtins
import json
import math
import os
import sys

import bpy
import numpy

# Debian's glTF exporter uses names that its numpy no longer has
for missing in ('bool', 'int', 'float', 'object', 'str'):
    if missing not in numpy.__dict__:
        setattr(numpy, missing, getattr(builtins, missing))


def material(name, colour, glow=0.0):
    m = bpy.data.materials.new(name)
    m.use_nodes = True
    shader = m.node_tree.nodes['Principled BSDF']
    shader.inputs['Base Color'].default_value = (*colour, 1.0)
    if glow:
        shader.inputs['Emission'].default_value, shader.inputs['Emission Strength'].default_value = (
            1.0, 0.9, 0.7, 1.0), glow
    m.use_backface_culling = single_sided  # what the exporter reads as doubleSided: false
    return m


def named(name, m):
    thing = bpy.context.active_object
    thing.name = thing.data.name = name
    thing.data.materials.clear()
    thing.data.materials.append(m)
    return thing


def box(name, low, high, m):
    bpy.ops.mesh.primitive_cube_add(size=1, location=[(a + b) / 2 for a, b in zip(low, high)])
    thing = named(name, m)
    thing.scale = [b - a for a, b in zip(low, high)]
    return thing


def subdivide(thing, cuts):
    bpy.ops.object.mode_set(mode='EDIT')
    bpy.ops.mesh.subdivide(number_cuts=cuts)
    bpy.ops.object.mode_set(mode='OBJECT')


def joined(name, parts):
    bpy.ops.object.select_all(action='DESELECT')
    for p in parts:
        p.select_set(True)
    bpy.context.view_layer.objects.active = parts[0]
    bpy.ops.object.join()
    parts[0].name = parts[0].data.name = name
    return parts[0]


def quad(name, corners, m):
    """A parallelogram without thickness, corners counter-clockwise from its front."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    return placed(name, mesh, m)


def placed(name, mesh, m):
    mesh.uv_layers.new(name='UVMap')
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.objects.active = thing
    return named(name, m)


def sheet(name, corners, m):
    """What has no thickness and is seen from both sides. Where surfaces are to have one side only, a closed slab of a
    centimetre."""
    if not single_sided:
        return quad(name, corners, m)
    a, b, c, d = (numpy.array(v, float) for v in corners)
    n = numpy.cross(b - a, d - a)
    back = [v - 0.01 * n / numpy.linalg.norm(n) for v in (a, b, c, d)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(v) for v in (a, b, c, d, *back)], [],
                     [(0, 1, 2, 3), (7, 6, 5, 4), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)])
    return placed(name, mesh, m)


def shell(name, low, high, m, sides='xXyYzZ'):
    """The inside of a box, without thickness; `sides` that are there (small letter: the low one)."""
    (x, y, z), (X, Y, Z) = low, high
    corners = {'z': [(x, y, z), (X, y, z), (X, Y, z), (x, Y, z)], 'Z': [(x, y, Z), (x, Y, Z), (X, Y, Z), (X, y, Z)],
               'x': [(x, y, z), (x, Y, z), (x, Y, Z), (x, y, Z)], 'X': [(X, y, z), (X, y, Z), (X, Y, Z), (X, Y, z)],
               'y': [(x, y, z), (x, y, Z), (X, y, Z), (X, y, z)], 'Y': [(x, Y, z), (X, Y, z), (X, Y, Z), (x, Y, Z)]}
    return [quad('%s %s' % (name, s), corners[s], m) for s in sides]


def lamp(name, kind, energy, place, turn=(0, 0, 0)):
    data = bpy.data.lights.new(name, kind)
    data.energy = energy
    if kind == 'SUN':
        data.angle = 0.0
    else:
        data.shadow_soft_size = 0.0
    thing = bpy.data.objects.new(name, data)
    thing.location, thing.rotation_euler = place, turn
    bpy.context.scene.collection.objects.link(thing)


def table(name, x, y, m):
    legs = [box('leg', (x + i * 1.1, y + j * 0.6, 0), (x + i * 1.1 + 0.08, y + j * 0.6 + 0.08, 0.71), m)
            for i in (0, 1) for j in (0, 1)]
    return [joined(name + ' legs', legs), box(name + ' top', (x - 0.1, y - 0.1, 0.7), (x + 1.28, y + 0.78, 0.74), m)]


def ball(name, place, radius, m):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, location=place, segments=24, ring_count=12)
    bpy.ops.object.shade_smooth()
    return named(name, m)


def sunny():
    plaster, wood, red = material('plaster', (0.8, 0.78, 0.74)), material('wood', (0.5, 0.3, 0.15)), material(
        'red', (0.7, 0.1, 0.1))
    box('floor', (-0.2, -0.2, -0.2), (5.2, 4.2, 0), wood)
    box('ceiling', (-0.2, -0.2, 2.7), (5.2, 4.2, 2.9), plaster)
    box('west', (-0.2, 0, 0), (0, 4, 2.7), plaster)
    box('north', (-0.2, 4, 0), (5.2, 4.2, 2.7), plaster)
    box('east', (5, 0, 0), (5.2, 4, 2.7), red)
    joined('south',
           [box('s', (-0.2, -0.2, 0), (1.5, 0, 2.7), plaster), box('s', (3.5, -0.2, 0), (5.2, 0, 2.7), plaster),
                     box('s', (1.5, -0.2, 0), (3.5, 0, 0.9), plaster),
                     box('s', (1.5, -0.2, 2.2), (3.5, 0, 2.7), plaster)])
    table('table', 1.8, 1.5, wood)
    ball('ball', (2.3, 1.9, 0.95), 0.2, red)
    lamp('Sun', 'SUN', 4.0, (0, -3, 5), (math.radians(50), 0, math.radians(20)))
    return 1.0


def flat():
    paint, blue, grey = material('paint', (0.75, 0.75, 0.75)), material('blue', (0.15, 0.25, 0.7)), material(
        'grey', (0.4, 0.4, 0.4))
    # each room has walls and a floor of its own: a texel that lies on both sides of a wall without thickness would let
    # light through
    shell('big', (0, 0, 0), (4, 4, 2.6), paint, 'xyYZ')
    shell('big boards', (0, 0, 0), (4, 4, 2.6), grey, 'z')
    shell('small', (4, 0, 0), (7, 4, 2.6), paint, 'XyYZ')
    shell('small boards', (4, 0, 0), (7, 4, 2.6), grey, 'z')
    # one sheet between them, seen from both sides, with a door
    joined('between', [sheet('b', [(4, 0, 0), (4, 1.5, 0), (4, 1.5, 2.6), (4, 0, 2.6)], blue),
                       sheet('b', [(4, 2.5, 0), (4, 4, 0), (4, 4, 2.6), (4, 2.5, 2.6)], blue),
                       sheet('b', [(4, 1.5, 2.1), (4, 2.5, 2.1), (4, 2.5, 2.6), (4, 1.5, 2.6)], blue)])
    box('crate', (5.2, 2.6, 0), (6.0, 3.4, 0.8), grey)
    sheet('paper', [(1.2, 2.4, 1.4), (2.0, 2.4, 1.4), (2.0, 2.8, 2.0), (1.2, 2.8, 2.0)], paint)
    lamp('Lamp', 'POINT', 100.0, (2, 2, 2.3))
    lamp('Night light', 'POINT', 8.0, (6.5, 0.5, 0.4))
    return 0.0


def furnished():
    paint, wood, green = material('paint', (0.7, 0.72, 0.7)), material('wood', (0.45, 0.3, 0.2)), material(
        'green', (0.1, 0.5, 0.2))
    shell('room', (0, 0, 0), (4, 5, 2.8), paint)
    glow = box('glow', (1.4, 2.0, 2.30), (2.6, 3.0, 2.35), material('glow', (0.5, 0.5, 0.5), 12.0))
    subdivide(glow, 5)
    joined('shelf', [box('b', (0.05, 1.0, 0.3 + 0.5 * i), (0.40, 2.6, 0.32 + 0.5 * i), wood) for i in range(4)] +
           [box('b', (0.05, 0.98, 0), (0.40, 1.0, 1.9), wood), box('b', (0.05, 2.6, 0), (0.40, 2.62, 1.9), wood)])
    sheet('curtain', [(3.4, 1.0, 0.2), (3.4, 3.2, 0.2), (3.6, 3.2, 2.4), (3.6, 1.0, 2.4)], green)
    box('crate', (2.0, 3.6, 0), (2.8, 4.4, 0.8), wood)
    box('crate on it', (2.1, 3.7, 0.8), (2.6, 4.2, 1.3), green)
    bpy.ops.mesh.primitive_torus_add(location=(1.6, 1.2, 0.6), major_radius=0.4, minor_radius=0.15, major_segments=24,
                                     minor_segments=10, rotation=(1.0, 0.3, 0))
    bpy.ops.object.shade_smooth()
    named('torus', green)
    return 0.0


def meshes():
    return [o for o in bpy.data.objects if o.type == 'MESH']


def unwrap(thing):
    bpy.ops.object.select_all(action='DESELECT')
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    thing.data.uv_layers.active = thing.data.uv_layers.new(name='Lightmap')
    bpy.ops.object.mode_set(mode='EDIT')
    bpy.ops.mesh.select_all(action='SELECT')
    bpy.ops.uv.smart_project(angle_limit=math.radians(66), island_margin=0.02, scale_to_bounds=False)
    bpy.ops.object.mode_set(mode='OBJECT')
    thing.data.uv_layers.active_index = 0
    thing.data.uv_layers[0].active_render = True


def make_diffuse(m):
    tree = m.node_tree
    shader = tree.nodes['Principled BSDF']
    colour, glow = tuple(shader.inputs['Base Color'].default_value), shader.inputs['Emission Strength'].default_value
    light = tuple(shader.inputs['Emission'].default_value)
    tree.nodes.clear()
    output, diffuse = tree.nodes.new('ShaderNodeOutputMaterial'), tree.nodes.new('ShaderNodeBsdfDiffuse')
    diffuse.inputs['Color'].default_value, diffuse.inputs['Roughness'].default_value = colour, 0.0
    surface = diffuse.outputs[0]
    if max(light[:3]) > 0:
        emission, both = tree.nodes.new('ShaderNodeEmission'), tree.nodes.new('ShaderNodeAddShader')
        emission.inputs['Color'].default_value, emission.inputs['Strength'].default_value = light, glow
        tree.links.new(surface, both.inputs[0])
        tree.links.new(emission.outputs[0], both.inputs[1])
        surface = both.outputs[0]
    tree.links.new(surface, output.inputs['Surface'])


def set_up(samples, bounces, sky):
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new('sky')
    scene.world.use_nodes = True
    background = scene.world.node_tree.nodes['Background']
    background.inputs['Color'].default_value, background.inputs['Strength'].default_value = (1.0, 1.0, 1.0, 1.0), sky
    scene.render.engine = 'CYCLES'
    c = scene.cycles
    c.device, c.samples, c.use_denoising, c.use_adaptive_sampling = 'CPU', samples, False, False
    c.max_bounces = c.diffuse_bounces = bounces
    c.sample_clamp_direct = c.sample_clamp_indirect = c.light_sampling_threshold = c.blur_glossy = 0.0
    bake = scene.render.bake
    bake.use_pass_direct, bake.use_pass_indirect, bake.use_pass_color = True, True, False
    bake.margin, bake.use_clear = 0, True


def bake(thing, side, path):
    image = bpy.data.images.new('target', side, side, alpha=True, float_buffer=True)
    image.colorspace_settings.name = 'Non-Color'
    image.generated_color = (0, 0, 0, 0)
    for slot in thing.material_slots:
        tree = slot.material.node_tree
        node = tree.nodes.get('target') or tree.nodes.new('ShaderNodeTexImage')
        node.name, node.image = 'target', image
        tree.nodes.active = node
    bpy.ops.object.select_all(action='DESELECT')
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.bake(type='DIFFUSE', pass_filter={'DIRECT', 'INDIRECT'}, margin=0, use_clear=True,
                        uv_layer='Lightmap', target='IMAGE_TEXTURES',
                        save_mode='INTERNAL')
    settings = bpy.context.scene.render.image_settings
    settings.file_format, settings.color_mode = 'OPEN_EXR', 'RGBA'
    settings.color_depth, settings.exr_codec = '32', 'ZIP'
    image.save_render(path)
    bpy.data.images.remove(image)


INTERIORS = {'sunny': sunny, 'flat': flat, 'furnished': furnished}
name, folder, side, samples, bounces, *flags = sys.argv[sys.argv.index('--') + 1:]
single_sided = '--single-sided' in flags


def main():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    sky = INTERIORS[name]()
    for thing in meshes():
        unwrap(thing)
    bpy.ops.export_scene.gltf(filepath=os.path.join(folder, 'scene.glb'), export_lights=True)
    bpy.ops.wm.save_as_mainfile(filepath=os.path.join(folder, 'scene.blend'))
    print('MADE ' + json.dumps({'sky': sky, 'objects': sorted(o.name for o in meshes())}), flush=True)
    if '--no-bake' in flags:
        return
    for m in bpy.data.materials:
        make_diffuse(m)
    set_up(int(samples), int(bounces), sky)
    for seed in (1, 2):
        bpy.context.scene.cycles.seed = seed
        for thing in meshes():
            bake(thing, int(side), os.path.join(folder, '%s_%d.exr' % (thing.name.replace(' ', '_'), seed)))


main()
