"""Shows a bake in Blender (3.4 or later): every baked object emits albedo * E / pi, the radiance of a diffuse surface
in that light.

    blender --python jobs/recipes/blender.py -- DIR           makes a new scene with DIR/scene.glb and its lightmaps
    blender my.blend --python jobs/recipes/blender.py -- DIR     the same applies them to your own objects of the same
                                                                 names
    ... -- DIR --exposure -10 --save shown.blend              exposure in stops; by default from the mean light

On your own objects the lightmap's UVs are copied to a UV map called "kiln", corner by corner. A mesh that differs from
the baked one (a modifier was applied on export, or it was edited since) is replaced by the baked mesh; the script
prints which.

For a set-up of your own:
- unit: a lightmap holds irradiance E, W/m2 or lux. Emission strength = albedo * E / pi. Hide the sun and the lamps that
  were baked.
- rows: Blender's V goes up and glTF's goes down; its importer flips UVs (v = 1 - v) and its images have the bottom row
  at V = 0. So a lightmap fits the imported UVs unchanged. A page's offset must be flipped too: see `page_place`.
- UV set: TEXCOORD_1 is imported as the second UV map. Image: colour space Non-Color, interpolation Linear, extension
  Extend.
- look: in Cycles or EEVEE, Rendered view; use emission only, so that no light is counted twice.
"""
import builtins
import json
import math
import os
import sys

import bpy
import numpy

# Debian's glTF importer uses names that its numpy no longer has.
for missing in ('bool', 'int', 'float', 'object', 'str'):
    if missing not in numpy.__dict__:
        setattr(numpy, missing, getattr(builtins, missing))

LAYER = 'kiln'


def entry_of(thing):
    """The lightmap entry of an imported object, or {}. It is stored in extras, which become custom properties."""
    entry = thing.get('kiln_lightmap')
    entry = entry.to_dict() if entry is not None else {}
    if 'instances' in entry:
        print('kiln: %s is drawn as instances with separate lightmaps, which this recipe does not support' % thing.name)
    return entry if 'file' in entry else {}


def import_scene(folder):
    """Imports DIR/scene.glb; returns [(object, entry)] of the baked objects, and all imported objects."""
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=os.path.join(folder, 'scene.glb'))
    new = [o for o in bpy.data.objects if o not in before]
    entries = [(o, entry_of(o)) for o in new if o.type == 'MESH']
    return [(o, e) for o, e in entries if e], new


def page_place(entry):
    """(scale, offset) for Blender's UVs, whose V goes up."""
    (sx, sy), (ox, oy) = entry['scale'], entry['offset']
    return (sx, sy), (ox, 1.0 - sy - oy)


def load_page(folder, entry):
    if entry['encoding'] != 'exr':
        raise RuntimeError('the lightmaps are %s: this recipe reads EXR (kiln export --format exr)' % entry['encoding'])
    image = bpy.data.images.load(os.path.join(folder, entry['file']), check_existing=True)
    image.colorspace_settings.name = 'Non-Color'
    return image


def albedo_of(tree, into):
    """Links the material's base colour to the socket `into`, or copies its value."""
    shader = next((n for n in tree.nodes if n.type == 'BSDF_PRINCIPLED'), None)
    colour = shader.inputs['Base Color'] if shader else None
    if colour is not None and colour.is_linked:
        tree.links.new(colour.links[0].from_socket, into)
    else:
        into.default_value = colour.default_value if colour is not None else (0.8, 0.8, 0.8, 1.0)


def own_emission(tree):
    """(colour socket, strength) of the material's own emission, or None."""
    shader = next((n for n in tree.nodes if n.type == 'BSDF_PRINCIPLED'), None)
    name = 'Emission' if shader and 'Emission' in shader.inputs else 'Emission Color'
    if shader is None or name not in shader.inputs:
        return None
    colour, strength = shader.inputs[name], shader.inputs['Emission Strength'].default_value
    return (colour, strength) if strength > 0 and (colour.is_linked or max(colour.default_value[:3]) > 0) else None


def lit_material(material, image, entry, layer):
    """A copy of the material that emits albedo * E / pi, plus its own emission."""
    lit = material.copy() if material else bpy.data.materials.new(LAYER)
    lit.use_nodes = True
    tree = lit.node_tree
    new = lambda kind: tree.nodes.new('ShaderNode' + kind)
    uv, place, light, glow, product = new('UVMap'), new('Mapping'), new('TexImage'), new('Emission'), new('MixRGB')
    uv.uv_map = layer
    scale, offset = page_place(entry)
    place.inputs['Scale'].default_value, place.inputs['Location'].default_value = (*scale, 1.0), (*offset, 0.0)
    light.name, light.image, light.interpolation, light.extension = 'kiln lightmap', image, 'Linear', 'EXTEND'
    product.name, product.blend_type, product.inputs['Fac'].default_value = 'kiln albedo', 'MULTIPLY', 1.0
    glow.inputs['Strength'].default_value = 1.0 / math.pi
    tree.links.new(uv.outputs['UV'], place.inputs['Vector'])
    tree.links.new(place.outputs['Vector'], light.inputs['Vector'])
    tree.links.new(light.outputs['Color'], product.inputs['Color1'])
    albedo_of(tree, product.inputs['Color2'])
    tree.links.new(product.outputs['Color'], glow.inputs['Color'])
    surface, own = glow.outputs['Emission'], own_emission(tree)
    if own is not None:
        lamp, both = new('Emission'), new('AddShader')
        lamp.inputs['Strength'].default_value = own[1]
        if own[0].is_linked:
            tree.links.new(own[0].links[0].from_socket, lamp.inputs['Color'])
        else:
            lamp.inputs['Color'].default_value = own[0].default_value
        tree.links.new(surface, both.inputs[0])
        tree.links.new(lamp.outputs['Emission'], both.inputs[1])
        surface = both.outputs['Shader']
    output = next((n for n in tree.nodes if n.type == 'OUTPUT_MATERIAL'), None) or new('OutputMaterial')
    tree.links.new(surface, output.inputs['Surface'])
    return lit


def put_lightmap(thing, entry, folder, layer):
    """Gives an object lit copies of its materials. A mesh with several users is copied: each has its own lightmap."""
    if thing.data.users > 1:
        thing.data = thing.data.copy()
    image = load_page(folder, entry)
    if not thing.data.materials:
        thing.data.materials.append(None)
    for i, material in enumerate(list(thing.data.materials)):
        thing.data.materials[i] = lit_material(material, image, entry, layer)
    return image


def corners(mesh):
    """[(key, (loop, loop, loop))] of the mesh's triangles; the key is the set of their corners' positions."""
    mesh.calc_loop_triangles()
    place = lambda loop: tuple(round(c, 5) for c in mesh.vertices[mesh.loops[loop].vertex_index].co)
    return [(frozenset(place(l) for l in t.loops), {place(l): l for l in t.loops}) for t in mesh.loop_triangles]


def copy_layout(baked, own, texcoord):
    """Copies the baked mesh's lightmap UVs to the UV map LAYER of `own`. False when a triangle of `own` is not in the
    baked mesh, or a corner of one of its polygons would need two UVs."""
    source, there = baked.uv_layers[texcoord].data, dict(corners(baked))
    found = {}
    for key, loops in corners(own):
        if key not in there:
            return False
        for place, loop in loops.items():
            uv = tuple(source[there[key][place]].uv)
            if max(abs(a - b) for a, b in zip(found.setdefault(loop, uv), uv)) > 1e-5:
                return False
    layer = own.uv_layers.get(LAYER) or own.uv_layers.new(name=LAYER)
    if layer is None:
        return False  # a mesh can have at most eight UV maps
    for loop, uv in found.items():
        layer.data[loop].uv = uv
    return True


def put_on_own(folder):
    """Prepares the objects of the opened file. Returns [(object, entry, UV map)]."""
    mine = {o.name: o for o in bpy.data.objects if o.type == 'MESH'}
    names = {}
    for thing in mine.values():  # the importer appends a number to a name that is taken: free the names
        names[thing] = thing.name
        thing.name = '%s (own)' % thing.name
    baked, new = import_scene(folder)
    twins = {o.name: (o, e) for o, e in baked}
    result = []
    for thing, name in names.items():
        if name not in twins:
            print('kiln: %s was not baked' % name)
            continue
        twin, entry = twins[name]
        if thing.modifiers or not copy_layout(twin.data, thing.data, entry['texCoord']):
            print('kiln: the mesh of %s differs from the baked one and is replaced by it' % name)
            thing.modifiers.clear()
            thing.data = twin.data.copy()
            thing.data.uv_layers[entry['texCoord']].name = LAYER
        result.append((thing, entry))
    for thing in new:
        bpy.data.objects.remove(thing)
    for thing, name in names.items():
        thing.name = name
    for name in twins.keys() - mine.keys():
        print('kiln: %s was baked but is not in this file' % name)
    return [(thing, entry, LAYER) for thing, entry in result]


def put_on_import(folder):
    return [(thing, entry, thing.data.uv_layers[entry['texCoord']].name) for thing, entry in import_scene(folder)[0]]


def switch_off_lights(all_of_them):
    """Hides the lights that are in the lightmaps, whose light would count twice: those that scene.glb marks or, in a
    file of your own, all. Blender's world is left unchanged: it does not affect emission."""
    lights = [o for o in bpy.data.objects if o.type == 'LIGHT' and (all_of_them or o.get('kiln_baked'))]
    for light in lights:
        light.hide_render = True
        light.hide_set(True)
    return len(lights)


def mean_irradiance(images):
    total = count = 0.0
    for image in images:
        values = numpy.empty(4 * image.size[0] * image.size[1], numpy.float32)
        image.pixels.foreach_get(values)
        green = values[1::4]
        total, count = total + float(green[green > 0].sum()), count + int((green > 0).sum())
    return total / count if count else 1.0


def apply(folder, own_objects, exposure=None):
    """Applies the lightmaps of DIR to the objects, hides the lights, sets the exposure.
    Returns [(object, entry, UV map)]."""
    lit = put_on_own(folder) if own_objects else put_on_import(folder)
    if not lit:
        raise RuntimeError('no object has a lightmap: was %s written by kiln bake?' % os.path.join(folder, 'scene.glb'))
    images = {put_lightmap(thing, entry, folder, layer) for thing, entry, layer in lit}
    lights = switch_off_lights(own_objects)
    if exposure is None:
        exposure = math.log2(math.pi / mean_irradiance(images))
    bpy.context.scene.view_settings.exposure = max(-32.0, min(32.0, exposure))
    print('kiln: %d objects lit from %d images, %d lights hidden, exposure %.1f stops' %
          (len(lit), len(images), lights, exposure))
    return lit


def main(arguments):
    if not arguments:
        sys.exit('usage: blender [my.blend] --python blender.py -- DIR [--exposure STOPS] [--save FILE.blend]')
    folder, options = os.path.abspath(arguments[0]), dict(zip(arguments[1::2], arguments[2::2]))
    own_objects = bpy.data.filepath != ''
    if not own_objects:
        bpy.ops.wm.read_factory_settings(use_empty=True)
    apply(folder, own_objects, float(options['--exposure']) if '--exposure' in options else None)
    if '--save' in options:
        bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath(options['--save']))


if __name__ == '__main__':
    main(sys.argv[sys.argv.index('--') + 1:] if '--' in sys.argv else [])
