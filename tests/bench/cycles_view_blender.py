"""Runs inside Blender: a picture of a .glb by Cycles on the CPU, with the materials that kiln takes them for.

  blender --background -noaudio --factory-startup --python cycles_view_blender.py -- PLAN.json

The plan has: scene (a .glb with a camera), output (an .exr of 32 bits), width, height, samples, seed, threads.
Materials are made anew from the file's: a metal is Principled with multiple scattering of its facets, glass with a body
is the Glass shader, what emits does so on its front, and everything else is Diffuse. No clamping, no filter of gloss,
no adaptive sampling, no denoiser, pixels as boxes, 64 bounces. Prints one line VIEW {json} with the seconds of the
processor that rendering took.
"""
import builtins
import json
import resource
import sys

import bpy
import numpy

for name in ('bool', 'int', 'float'):  # Debian's glTF importer uses names that its numpy no longer has
    if name not in numpy.__dict__:
        setattr(numpy, name, getattr(builtins, name))


def document(path):
    with open(path, 'rb') as f:
        data = f.read()
    return json.loads(data[20:20 + int.from_bytes(data[12:16], 'little')])


def surface(tree, material):
    """The shader of what a glTF material does with light."""
    pbr, extensions = material.get('pbrMetallicRoughness', {}), material.get('extensions', {})
    colour = (*pbr.get('baseColorFactor', (1.0, 1.0, 1.0))[:3], 1.0)
    if pbr.get('metallicFactor', 1.0) == 1.0:
        shader = tree.nodes.new('ShaderNodeBsdfPrincipled')
        shader.distribution = 'MULTI_GGX'
        shader.inputs['Base Color'].default_value = colour
        shader.inputs['Metallic'].default_value = 1.0
        shader.inputs['Roughness'].default_value = pbr.get('roughnessFactor', 1.0)
    elif 'KHR_materials_volume' in extensions:
        shader = tree.nodes.new('ShaderNodeBsdfGlass')
        shader.inputs['Color'].default_value = colour
        shader.inputs['Roughness'].default_value = pbr.get('roughnessFactor', 1.0)
        shader.inputs['IOR'].default_value = extensions.get('KHR_materials_ior', {}).get('ior', 1.5)
    else:
        shader = tree.nodes.new('ShaderNodeBsdfDiffuse')
        shader.inputs['Color'].default_value = colour
    return shader.outputs['BSDF']


def emission(tree, material):
    """Emission of the front alone."""
    strength = material.get('extensions', {}).get('KHR_materials_emissive_strength', {}).get('emissiveStrength', 1.0)
    glow, dark = tree.nodes.new('ShaderNodeEmission'), tree.nodes.new('ShaderNodeEmission')
    glow.inputs['Color'].default_value = (*material['emissiveFactor'], 1.0)
    glow.inputs['Strength'].default_value, dark.inputs['Strength'].default_value = strength, 0.0
    front, mix = tree.nodes.new('ShaderNodeNewGeometry'), tree.nodes.new('ShaderNodeMixShader')
    tree.links.new(front.outputs['Backfacing'], mix.inputs['Fac'])
    tree.links.new(glow.outputs['Emission'], mix.inputs[1])
    tree.links.new(dark.outputs['Emission'], mix.inputs[2])
    return mix.outputs['Shader']


def rebuild(material):
    target = bpy.data.materials.get(material['name'])
    if target is None:
        return
    tree = target.node_tree
    tree.nodes.clear()
    output, shader = tree.nodes.new('ShaderNodeOutputMaterial'), surface(tree, material)
    if any(material.get('emissiveFactor', ())):
        both = tree.nodes.new('ShaderNodeAddShader')
        tree.links.new(shader, both.inputs[0])
        tree.links.new(emission(tree, material), both.inputs[1])
        shader = both.outputs['Shader']
    tree.links.new(shader, output.inputs['Surface'])


def settings(scene, plan):
    cycles, render = scene.cycles, scene.render
    render.engine, cycles.device = 'CYCLES', 'CPU'
    render.resolution_x, render.resolution_y, render.resolution_percentage = plan['width'], plan['height'], 100
    render.threads_mode, render.threads = 'FIXED', plan['threads']
    render.image_settings.file_format, render.image_settings.color_depth = 'OPEN_EXR', '32'
    render.filepath = plan['output']
    cycles.samples, cycles.seed, cycles.use_adaptive_sampling, cycles.use_denoising = (
        plan['samples'], plan['seed'], False, False)
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = cycles.light_sampling_threshold = 0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.pixel_filter_type = 'BOX'
    for kind in ('max', 'diffuse', 'glossy', 'transmission', 'transparent_max'):
        setattr(cycles, kind + '_bounces' if not kind.endswith('_max') else 'transparent_max_bounces', 64)
    world = bpy.data.worlds.new('none')
    world.use_nodes = True
    world.node_tree.nodes['Background'].inputs['Strength'].default_value = 0.0
    scene.world = world


def main():
    with open(sys.argv[sys.argv.index('--') + 1], encoding='utf-8') as f:
        plan = json.load(f)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=plan['scene'])
    for material in document(plan['scene'])['materials']:
        rebuild(material)
    scene = bpy.context.scene
    settings(scene, plan)
    scene.camera = next(o for o in bpy.data.objects if o.type == 'CAMERA')
    before = resource.getrusage(resource.RUSAGE_SELF)
    bpy.ops.render.render(write_still=True)
    after = resource.getrusage(resource.RUSAGE_SELF)
    print('VIEW', json.dumps({'processor': after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime}))


if __name__ == '__main__':
    main()
