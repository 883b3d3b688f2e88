"""Runs inside Blender: bakes a .glb's lightmap atlas with Cycles on the CPU, once for each `samples:seed`.

  blender --background -noaudio --factory-startup --python cycles_bake.py -- SCENE.glb OUT_FOLDER SIDE BOUNCES THREADS
  64:1 256:2 ...

Every material becomes a Lambertian surface (diffuse of the base colour plus emission): the importer's own has a
specular lobe. All meshes that reflect are joined, which is the fastest way to bake: one session, one BVH. Type DIFFUSE,
direct and indirect, without colour, no margin, no clamping, no adaptive sampling, no denoiser; a 32-bit OpenEXR file
whose unit is irradiance over pi. Prints one line BAKE {json} a bake; `seconds` is the bake operator alone.
"""
import builtins
import json
import os
import sys
import time

import bpy
import numpy

for name in ('bool', 'int', 'float'):  # Debian's glTF importer uses names that its numpy no longer has
    if name not in numpy.__dict__:
        setattr(numpy, name, getattr(builtins, name))


def colours(path):
    """{material: (albedo, radiance)} from the file itself."""
    with open(path, 'rb') as f:
        data = f.read()
    document = json.loads(data[20:20 + int.from_bytes(data[12:16], 'little')])
    result = {}
    for m in document['materials']:
        strength = m.get('extensions', {}).get('KHR_materials_emissive_strength', {}).get('emissiveStrength', 1.0)
        result[m['name']] = (m['pbrMetallicRoughness']['baseColorFactor'][:3],
                             [c * strength for c in m.get('emissiveFactor', (0, 0, 0))])
    return result


def make_lambertian(material, albedo, radiance):
    tree = material.node_tree
    tree.nodes.clear()
    output, diffuse = tree.nodes.new('ShaderNodeOutputMaterial'), tree.nodes.new('ShaderNodeBsdfDiffuse')
    diffuse.inputs['Color'].default_value = (*albedo, 1.0)
    diffuse.inputs['Roughness'].default_value = 0.0
    surface = diffuse.outputs[0]
    if max(radiance) > 0:
        emission, both = tree.nodes.new('ShaderNodeEmission'), tree.nodes.new('ShaderNodeAddShader')
        emission.inputs['Color'].default_value = (*[c / max(radiance) for c in radiance], 1.0)
        emission.inputs['Strength'].default_value = max(radiance)
        tree.links.new(surface, both.inputs[0])
        tree.links.new(emission.outputs[0], both.inputs[1])
        surface = both.outputs[0]
    tree.links.new(surface, output.inputs['Surface'])


def prepare(path, bounces, threads):
    """The joined object to bake."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=os.path.abspath(path))
    table = colours(path)
    for material in bpy.data.materials:
        if material.name in table:
            make_lambertian(material, *table[material.name])
    meshes = [o for o in bpy.data.objects if o.type == 'MESH'
              and any(max(table[s.material.name][0]) > 0 for s in o.material_slots)]
    bpy.ops.object.select_all(action='DESELECT')
    for o in meshes:
        o.select_set(True)
    bpy.context.view_layer.objects.active = meshes[0]
    bpy.ops.object.join()
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new('black')
    scene.world.use_nodes = True
    scene.world.node_tree.nodes['Background'].inputs['Strength'].default_value = 0.0
    scene.render.engine = 'CYCLES'
    scene.render.threads_mode, scene.render.threads = 'FIXED', threads
    c = scene.cycles
    c.device, c.use_denoising, c.use_adaptive_sampling = 'CPU', False, False
    c.max_bounces = c.diffuse_bounces = bounces
    c.sample_clamp_direct = c.sample_clamp_indirect = 0.0
    bake = scene.render.bake
    bake.use_pass_direct, bake.use_pass_indirect, bake.use_pass_color = True, True, False
    bake.margin, bake.use_clear = 0, True
    return bpy.context.view_layer.objects.active


def new_target(target, side):
    image = bpy.data.images.new('atlas', side, side, alpha=True, float_buffer=True)
    image.colorspace_settings.name = 'Non-Color'
    for slot in target.material_slots:
        tree = slot.material.node_tree
        node = tree.nodes.get('target') or tree.nodes.new('ShaderNodeTexImage')
        node.name, node.image = 'target', image
        tree.nodes.active = node
    return image


def save(image, path):
    settings = bpy.context.scene.render.image_settings
    settings.file_format, settings.color_mode = 'OPEN_EXR', 'RGBA'
    settings.color_depth, settings.exr_codec = '32', 'ZIP'
    image.save_render(path)


def main():
    scene_path, folder, side, bounces, threads, *runs = sys.argv[sys.argv.index('--') + 1:]
    target = prepare(scene_path, int(bounces), int(threads))
    for run in runs:
        samples, seed = map(int, run.split(':'))
        scene = bpy.context.scene
        scene.cycles.samples, scene.cycles.seed = samples, seed
        image = new_target(target, int(side))
        begin = time.perf_counter()
        bpy.ops.object.bake(type='DIFFUSE', pass_filter={'DIRECT', 'INDIRECT'}, margin=0, use_clear=True,
                            uv_layer=target.data.uv_layers[1].name, target='IMAGE_TEXTURES', save_mode='INTERNAL')
        seconds = time.perf_counter() - begin
        path = os.path.join(folder, 'cycles_%d_%d.exr' % (samples, seed))
        save(image, path)
        bpy.data.images.remove(image)
        print('BAKE ' + json.dumps({'file': path, 'samples': samples, 'seed': seed, 'seconds': seconds,
                                    'version': bpy.app.version_string}), flush=True)


main()
