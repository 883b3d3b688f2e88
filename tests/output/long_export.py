"""Every scene at hand, baked as quickly as can be with its own layouts and stripped of them, exported, and held to what
exported.py and the Khronos validator say; and an atlas of Sponza. Run by hand: minutes, and npm.

    npm install --prefix FOLDER gltf-validator
    long_export.py --kiln build/release/kiln --validator FOLDER [--sponza-density 16] [--only NAME]
"""
import glob
import json
import os
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import exported  # noqa: E402
import gltf_file  # noqa: E402
import harness  # noqa: E402

QUICK = ('--samples-direct', 1, '--samples-bounce', 1, '--samples-indirect', 1, '--bounces', 0, '--samples-probe', 0)
VALIDATE = '''const v = require(process.argv[1] + '/node_modules/gltf-validator'), fs = require('fs');
v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])), {maxIssues: 0})
  .then(r => console.log(JSON.stringify(r.issues)));'''


def validate(folder, path):
    answer = subprocess.run(['node', '-e', VALIDATE, folder, path], capture_output=True, text=True, check=True)
    return json.loads(answer.stdout)


def errors_of(issues):
    return {'%s %s' % (m['code'], m.get('pointer', '')) for m in issues['messages'] if m['severity'] == 0}


def scenes():
    names = []
    for part in ('own', 'own/features', 'own/extremes', 'third_party'):
        for ending in ('glb', 'gltf', 'obj'):
            names += glob.glob(os.path.join(harness.SHARED, part, '*.' + ending))
    return sorted(n for n in names if 'voxelcity' not in n)


def is_compressed(scene):
    required = gltf_file.File(scene).json.get('extensionsRequired', [])
    return any('draco' in name or 'meshopt' in name for name in required)


def one(kiln, checks, validator, scene, source, options=()):
    """Bakes `scene` and judges its scene.glb. `source` is said in messages. Returns the bake."""
    bake = kiln.bake(scene, '--lightmap-size', 32, *QUICK, *options)
    if bake.process.status == harness.BAD_INPUT and not os.path.exists(os.path.join(bake.directory, 'scene.kscene')):
        print('%-52s refused: %s' % (source, bake.process.sentence()[-60:]))
        return None
    if not checks.baked(bake):
        return None
    path = os.path.join(bake.directory, 'scene.glb')
    if not checks.that(os.path.exists(path), '%s: there is no scene.glb' % source, bake.process):
        return None
    issues = validate(validator, path)
    known = errors_of(validate(validator, scene)) if scene.endswith('.glb') else set()
    new = errors_of(issues) - known
    checks.that(not new, '%s: the validator finds %s' % (source, sorted(new)[:3]), bake.process)
    links = attributes = 0
    try:
        file, baked = gltf_file.File(path), exported.SceneFile(os.path.join(bake.directory, 'scene.kscene'))
        if not scene.endswith('.obj') and not is_compressed(scene):  # those are left to the validator
            links = exported.check_against_bake(file, baked)
            attributes = exported.check_against_source(file, gltf_file.File(scene))
    except AssertionError as fault:
        checks.that(False, '%s: %s' % (source, fault), bake.process)
    print('%-52s %5d links, %6d attributes the same, %.1f MB -> %.1f MB, %d errors (%d of the source)' % (
        source, links, attributes, os.path.getsize(scene) / 1e6, os.path.getsize(path) / 1e6, issues['numErrors'],
        len(known)), flush=True)
    return bake


def atlas_of_sponza(kiln, checks, density):
    scene = harness.need_shared('third_party', 'crytek_sponza.glb')
    bake = kiln.bake(scene, '--texels-per-metre', density, *QUICK, timeout=1800)
    if not checks.baked(bake):
        return
    path = os.path.join(bake.directory, 'atlas', 'scene.glb')
    process = kiln.command('export', bake.directory, '-o', path, '--atlas', 2048)
    if checks.that(process.status == 0, 'the atlas ended with %d' % process.status, process):
        used, points = exported.check_atlas(bake.directory, path, 20000)
        print('%s\nSponza at %g texels/m: %.1f %% used, the same at %d points' %
              (process.stdout.strip(), density, 100 * used, points))
        checks.that(used >= 0.7, 'only %.1f %% of the pages are used' % (100 * used), process)


def main():
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--validator', required=True, help='where gltf-validator is installed'),
                                    lambda p: p.add_argument('--sponza-density', type=float, default=16),
        lambda p: p.add_argument('--only', default=''))
    checks = harness.Checks()
    validator = os.path.abspath(arguments.validator)
    for scene in scenes():
        name = os.path.relpath(scene, harness.SHARED)
        if arguments.only not in name:
            continue
        bake = one(kiln, checks, validator, scene, name)
        if bake is not None and scene.endswith('.glb') and not is_compressed(scene):
            bare = os.path.join(kiln.scratch, 'bare_' + os.path.basename(scene))
            gltf_file.strip(scene, bare)
            other = one(kiln, checks, validator, bare, name + ', stripped')
            if other is not None:
                other.remove()
        if bake is not None:
            bake.remove()
    if arguments.only in 'sponza atlas':
        atlas_of_sponza(kiln, checks, arguments.sponza_density)
    checks.end()


if __name__ == '__main__':
    main()
