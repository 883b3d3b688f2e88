"""Runs inside Blender: a file as an artist has it, made by importing a scene: blender ... --python blender_own.py --
SCENE.glb FILE.blend"""
import builtins
import sys

import bpy
import numpy

# Debian's glTF importer uses names that its numpy no longer has
for missing in ('bool', 'int', 'float', 'object', 'str'):
    if missing not in numpy.__dict__:
        setattr(numpy, missing, getattr(builtins, missing))
scene, path = sys.argv[sys.argv.index('--') + 1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=scene)
bpy.ops.wm.save_as_mainfile(filepath=path)
