"""Runs inside Blender: bakes what `kiln bake` laid out with Cycles on the CPU, once for each `samples:seed`.

  blender --background -noaudio --factory-startup --python cycles_bake.py -- PLAN.json 64:1 256:2 ...

The plan says the scene (scene.glb of a bake, whose nodes link to their lightmaps), where each object's lightmap lies in
one atlas, bounces, threads, the sky and the folder for results. Every material becomes a Lambertian surface: diffuse of
the base colour, less what is metal, plus emission. The backs of single-sided materials are black, as kiln has them, and
alpha masks let light through. With `whole` in the plan metals and glass bodies are what they are, as in
cycles_view_blender.py, and send caustics. All objects of the plan are joined, which is the fastest way to bake: one
session, one BVH. Type DIFFUSE, direct and indirect, without colour, no margin, no clamping, no adaptive sampling, no
denoiser; a 32-bit OpenEXR file whose unit is irradiance over pi. Prints one line BAKE {json} a bake; `seconds` and
`processor` are of the bake operator alone.
"""
import builtins
import json
import os
import resource
import sys
import time

import bpy
import numpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cycles_view_blender as view  # noqa: E402

for name in ('bool', 'int', 'float'):  # Debian's glTF importer uses names that its numpy no longer has
    if name not in numpy.__dict__:
        setattr(numpy, name, getattr(builtins, name))

LAYOUT = 'kiln'


def document(path):
    with open(path, 'rb') as f:
        data = f.read()
    return json.loads(data[20:20 + int.from_bytes(data[12:16], 'little')])


class Colours:
    """What kiln reads of a glTF material."""

    def __init__(self, material):
        pbr = material.get('pbrMetallicRoughness', {})
        colour = pbr.get('baseColorFactor', (1.0, 1.0, 1.0, 1.0))
        matt = 1.0 - pbr.get('metallicFactor', 1.0)
        strength = material.get('extensions', {}).get('KHR_materials_emissive_strength', {})
        self.albedo, self.alpha = [c * matt for c in colour[:3]], colour[3]
        self.radiance = [c * strength.get('emissiveStrength', 1.0) for c in material.get('emissiveFactor', (0, 0, 0))]
        self.single_sided = not material.get('doubleSided', False)
        self.cutoff = material.get('alphaCutoff', 0.5) if material.get('alphaMode') == 'MASK' else None


def base_image(tree):
    """The image that the importer joined to the base colour, or None."""
    shader = next((n for n in tree.nodes if n.type == 'BSDF_PRINCIPLED'), None)
    links = list(shader.inputs['Base Color'].links) if shader else []
    while links:
        node = links.pop().from_node
        if node.type == 'TEX_IMAGE':
            return node.image
        links += [l for i in node.inputs for l in i.links]
    return None


class Shader:
    """Nodes of one material."""

    def __init__(self, material, colours):
        image = base_image(material.node_tree)
        self.tree = material.node_tree
        self.tree.nodes.clear()
        diffuse = self.node('ShaderNodeBsdfDiffuse')
        diffuse.inputs['Color'].default_value = (*colours.albedo, 1.0)
        texture = self.texture(image, colours, diffuse) if image else None
        surface = self.front_only(diffuse.outputs[0]) if colours.single_sided else diffuse.outputs[0]
        if max(colours.radiance) > 0:
            surface = self.emitting(surface, colours)
        if colours.cutoff is not None and texture:
            surface = self.masked(surface, texture, colours)
        self.tree.links.new(surface, self.node('ShaderNodeOutputMaterial').inputs['Surface'])

    def node(self, kind):
        return self.tree.nodes.new(kind)

    def texture(self, image, colours, diffuse):
        """Base colour times texture."""
        texture, uv, product = (self.node('ShaderNode' + k) for k in ('TexImage', 'UVMap', 'MixRGB'))
        texture.image, uv.uv_map = image, 'UVMap'
        product.blend_type, product.inputs['Fac'].default_value = 'MULTIPLY', 1.0
        product.inputs['Color2'].default_value = (*colours.albedo, 1.0)
        self.tree.links.new(uv.outputs[0], texture.inputs['Vector'])
        self.tree.links.new(texture.outputs['Color'], product.inputs['Color1'])
        self.tree.links.new(product.outputs[0], diffuse.inputs['Color'])
        return texture

    def mixed(self, share, first, second):
        mix = self.node('ShaderNodeMixShader')
        for value, socket in zip((share, first, second), mix.inputs):
            self.tree.links.new(value, socket)
        return mix.outputs[0]

    def front_only(self, surface):
        black = self.node('ShaderNodeBsdfDiffuse')
        black.inputs['Color'].default_value = (0, 0, 0, 1)
        return self.mixed(self.node('ShaderNodeNewGeometry').outputs['Backfacing'], surface, black.outputs[0])

    def emitting(self, surface, colours):
        emission, both = self.node('ShaderNodeEmission'), self.node('ShaderNodeAddShader')
        strength = max(colours.radiance)
        emission.inputs['Color'].default_value = (*[c / strength for c in colours.radiance], 1.0)
        emission.inputs['Strength'].default_value = strength
        self.tree.links.new(surface, both.inputs[0])
        self.tree.links.new(emission.outputs[0], both.inputs[1])
        return both.outputs[0]

    def masked(self, surface, texture, colours):
        there = self.node('ShaderNodeMath')
        there.operation, there.inputs[1].default_value = 'GREATER_THAN', colours.cutoff / colours.alpha
        self.tree.links.new(texture.outputs['Alpha'], there.inputs[0])
        return self.mixed(there.outputs[0], self.node('ShaderNodeBsdfTransparent').outputs[0], surface)


def is_gloss(material):
    return (material.get('pbrMetallicRoughness', {}).get('metallicFactor', 1.0) == 1.0
            or 'KHR_materials_volume' in material.get('extensions', {}))


def light_suns(gltf):
    """Irradiance as in the file; the importer's own takes lux for it."""
    for light in gltf.get('extensions', {}).get('KHR_lights_punctual', {}).get('lights', []):
        if light['type'] != 'directional':
            sys.exit('only directional lights are carried over, not "%s"' % light['type'])
        sun = bpy.data.lights[light['name']]
        sun.energy, sun.angle, sun.color = light['intensity'], 0.0, light.get('color', (1, 1, 1))


def light_sky(scene, radiance):
    scene.world = bpy.data.worlds.new('sky')
    scene.world.use_nodes = True
    background = scene.world.node_tree.nodes['Background'].inputs
    strength = max(radiance)
    background['Color'].default_value = (*[c / strength if strength > 0 else 0.0 for c in radiance], 1.0)
    background['Strength'].default_value = strength


def lay_out(target, number, place, atlas):
    """A UV layer that maps the object's lightmap to its place in the atlas; all numbers in texels, top row first."""
    if target.data.users > 1:
        target.data = target.data.copy()
    layers = target.data.uv_layers
    uv = numpy.empty(2 * len(target.data.loops), numpy.float32)
    layers[number].data.foreach_get('uv', uv)
    uv = uv.reshape(-1, 2).astype(numpy.float64)
    x, y, width, height = place
    uv[:, 0] = (x + uv[:, 0] * width) / atlas[0]
    uv[:, 1] = 1.0 - (y + (1.0 - uv[:, 1]) * height) / atlas[1]
    layers.new(name=LAYOUT, do_init=False).data.foreach_set('uv', uv.astype(numpy.float32).ravel())


def settings(scene, plan):
    scene.render.engine = 'CYCLES'
    scene.render.threads_mode, scene.render.threads = 'FIXED', plan['threads']
    c = scene.cycles
    c.device, c.use_denoising, c.use_adaptive_sampling = 'CPU', False, False
    c.max_bounces = c.diffuse_bounces = plan['bounces']
    if plan.get('whole'):
        c.max_bounces = c.glossy_bounces = c.transmission_bounces = 64
        c.caustics_reflective = c.caustics_refractive = True
        c.blur_glossy = c.light_sampling_threshold = 0.0
    c.transparent_max_bounces = 32
    c.sample_clamp_direct = c.sample_clamp_indirect = 0.0
    bake = scene.render.bake
    bake.use_pass_direct, bake.use_pass_indirect, bake.use_pass_color = True, True, False
    bake.margin, bake.use_clear = 0, True


def prepare(plan):
    """The joined object to bake."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=plan['scene'])
    gltf = document(plan['scene'])
    for material in gltf['materials']:
        if plan.get('whole') and is_gloss(material):
            view.rebuild(material)
        else:
            Shader(bpy.data.materials[material['name']], Colours(material))
    light_suns(gltf)
    light_sky(bpy.context.scene, plan['sky'])
    numbers = {n['name']: n['extensions']['KILN_lightmap']['texCoord'] for n in gltf['nodes']
               if 'KILN_lightmap' in n.get('extensions', {})}
    bpy.ops.object.select_all(action='DESELECT')
    for name, place in plan['places'].items():
        target = bpy.data.objects[name]
        lay_out(target, numbers[name], place, plan['atlas'])
        target.select_set(True)
        bpy.context.view_layer.objects.active = target
    bpy.ops.object.join()
    settings(bpy.context.scene, plan)
    return bpy.context.view_layer.objects.active


def new_image(target, atlas):
    image = bpy.data.images.new('atlas', *atlas, alpha=True, float_buffer=True)
    image.colorspace_settings.name = 'Non-Color'
    for slot in target.material_slots:
        tree = slot.material.node_tree
        node = tree.nodes.get('target') or tree.nodes.new('ShaderNodeTexImage')
        node.name, node.image = 'target', image
        tree.nodes.active = node
    return image


def save(image, path):
    options = bpy.context.scene.render.image_settings
    options.file_format, options.color_mode = 'OPEN_EXR', 'RGBA'
    options.color_depth, options.exr_codec = '32', 'ZIP'
    image.save_render(path)


def processor():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def main():
    plan_path, *runs = sys.argv[sys.argv.index('--') + 1:]
    with open(plan_path) as f:
        plan = json.load(f)
    target = prepare(plan)
    for run in runs:
        samples, seed = map(int, run.split(':'))
        cycles = bpy.context.scene.cycles
        cycles.samples, cycles.seed = samples, seed
        image = new_image(target, plan['atlas'])
        begin, before = time.perf_counter(), processor()
        bpy.ops.object.bake(type='DIFFUSE', pass_filter={'DIRECT', 'INDIRECT'}, margin=0, use_clear=True,
                            uv_layer=LAYOUT, target='IMAGE_TEXTURES', save_mode='INTERNAL')
        record = {'seconds': time.perf_counter() - begin, 'processor': processor() - before}
        path = os.path.join(plan['folder'], 'cycles_%d_%d.exr' % (samples, seed))
        save(image, path)
        bpy.data.images.remove(image)
        print('BAKE ' + json.dumps({'file': path, 'samples': samples, 'seed': seed, **record,
                                    'version': bpy.app.version_string}), flush=True)


main()
